#include "low_pass.h"

#include "decay.h"

#define FASTEST CGL_R(2.0) /* largest bandwidth * ts [-]: with a larger product the filter would hardly smooth */

CGL_SELDOM cgl_error cgl_low_pass_init(cgl_low_pass *filter, const cgl_low_pass_config *config, cgl_real ts)
{
    if (!cgl_is_positive(ts)) {
        return CGL_ERROR_CONFIG;
    }
    filter->ts = ts;
    cgl_low_pass_reset(filter, CGL_R(0.0));
    return cgl_low_pass_retune(filter, config);
}

CGL_SELDOM cgl_error cgl_low_pass_retune(cgl_low_pass *filter, const cgl_low_pass_config *config)
{
    const cgl_real x = config->bandwidth * filter->ts;
    if (!(cgl_is_positive(config->bandwidth) && x > CGL_R(0.0) && x <= FASTEST)) {
        return CGL_ERROR_CONFIG;
    }
    filter->config = *config;
    filter->share = CGL_R(1.0) - cgl_decay(x);
    return CGL_OK;
}

CGL_SELDOM void cgl_low_pass_reset(cgl_low_pass *filter, cgl_real x)
{
    filter->y = cgl_finite_or_zero(x);
}

cgl_real cgl_low_pass_step(cgl_low_pass *filter, cgl_real x)
{
    if (!cgl_is_finite(x)) {
        return x;
    }
    /* a weighted sum, as the difference of x and y may overflow */
    filter->y = (CGL_R(1.0) - filter->share) * filter->y + filter->share * x;
    return filter->y;
}
