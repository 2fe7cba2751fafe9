/* Results of init, and status bits of a step. */
#ifndef COGLESS_STATUS_H
#define COGLESS_STATUS_H

/* Returned by every init. Nothing but CGL_OK leaves a usable state. Which field was refused, cgl_NAME_bad_field says. */
typedef enum {
    CGL_OK = 0,
    CGL_ERROR_CONFIG = -1, /* a config field is outside its stated range or not finite */
    CGL_ERROR_MEMORY = -2  /* the caller's memory is missing, misaligned, or not of the length that the config needs */
} cgl_error;

/* The name of a config's field, for a report. With COGLESS_NO_TEXTS every name is empty, and takes no flash. */
#ifdef COGLESS_NO_TEXTS
#define CGL_FIELD(name) ""
#else
#define CGL_FIELD(name) name
#endif

/* What init writes into a state that is usable. A step finds neither zeros nor garbage to be one. */
#define CGL_READY 0x5ca1ab1eU

/* Bits of a step's status. */
enum {
    CGL_STATUS_SATURATED = 1,      /* the output is at its limit */
    CGL_STATUS_FAULT = 2,          /* an input was not finite or not plausible, or no init made the state; a safe output is held */
    CGL_STATUS_FROZEN = 4,         /* the learned memory was not changed in this step */
    CGL_STATUS_BUSY = 8,           /* a calibration run is under way: the reference is ignored */
    CGL_STATUS_ANGLE_LOST = 16,    /* angle or speed is not finite, or can't be: the last plausible one goes on */
    CGL_STATUS_ANGLE_SHIFTED = 32, /* the angle jumped; the jump is taken out, and learning waits until it comes back */
    CGL_STATUS_ANGLE_STUCK = 64,   /* the angle stands still while the reference turns */
    CGL_STATUS_CURRENT = 128,      /* a current is not finite, too large, or the three do not add up to zero */
    CGL_STATUS_BUS = 256,          /* the bus voltage is not finite or not positive */
    CGL_STATUS_OUTLIER = 512,      /* the error is far beyond the usual: nothing is learned from it */
    CGL_STATUS_OFF = 1024,         /* the output is held at zero: open the bridge, if the hardware can */
    CGL_STATUS_GUARDED = 2048      /* the guard holds learning back: it stands still, is tried more gently, or does not act */
};

#endif
