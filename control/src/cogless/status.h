/* Results of init, and status bits of a step. */
#ifndef COGLESS_STATUS_H
#define COGLESS_STATUS_H

/* The result of every init. Only CGL_OK leaves a usable state. cgl_NAME_bad_field() says which field was refused. */
typedef enum {
    CGL_OK = 0,
    CGL_ERROR_CONFIG = -1, /* a config field is outside its stated range or not finite */
    CGL_ERROR_MEMORY = -2  /* the caller's memory is missing, misaligned, or not of the length that the config needs */
} cgl_error;

/* The name of a config's field, for a report. With COGLESS_NO_TEXTS every name is empty and takes no flash. */
#ifdef COGLESS_NO_TEXTS
#define CGL_FIELD(name) ""
#else
#define CGL_FIELD(name) name
#endif

/* Init writes this number into a usable state. A step checks it, and so refuses a state of zeros or garbage. */
#define CGL_READY 0x5ca1ab1eU

/* Bits of a step's status. */
enum {
    CGL_STATUS_SATURATED = 1,      /* the output is at its limit */
    CGL_STATUS_FAULT = 2,          /* an input is not finite or not plausible, or init has not succeeded; the output has a safe value */
    CGL_STATUS_FROZEN = 4,         /* this step has not changed what is learned */
    CGL_STATUS_BUSY = 8,           /* a calibration run is under way: the reference is ignored */
    CGL_STATUS_ANGLE_LOST = 16,    /* angle or speed is missing or impossible; the rotor is assumed to turn on at its last plausible
                                      speed */
    CGL_STATUS_ANGLE_SHIFTED = 32, /* the angle has jumped; the jump is subtracted, and learning waits until the angle jumps back */
    CGL_STATUS_ANGLE_STUCK = 64,   /* the angle stands still although the reference turns */
    CGL_STATUS_CURRENT = 128,      /* a phase current is not finite, the currents are too large, or three do not add up to zero */
    CGL_STATUS_BUS = 256,          /* the bus voltage is not finite or not positive */
    CGL_STATUS_OUTLIER = 512,      /* the speed error is far above the usual one; nothing is learned from this error */
    CGL_STATUS_OFF = 1024,         /* the output is zero; open the bridge, if the hardware can */
    CGL_STATUS_GUARDED = 2048      /* the guard holds learning back: learning is frozen or gentler, or what is learned does not act */
};

#endif
