/* What init returns, and what a step says of itself. */
#ifndef COGLESS_STATUS_H
#define COGLESS_STATUS_H

/* Returned by every init. Nothing but CGL_OK leaves a usable state. */
typedef enum {
    CGL_OK = 0,
    CGL_ERROR_CONFIG = -1, /* a config field is outside its stated range or not finite */
    CGL_ERROR_MEMORY = -2  /* the caller's memory is missing or too small */
} cgl_error;

/* Bits of a step's status. */
enum {
    CGL_STATUS_SATURATED = 1, /* the output is at its limit */
    CGL_STATUS_FAULT = 2,     /* an input was not finite or not plausible; a safe output is held */
    CGL_STATUS_FROZEN = 4,    /* the learned memory was not changed in this step */
    CGL_STATUS_BUSY = 8       /* a calibration run is under way: the reference is ignored */
};

#endif
