/* Everything: for build systems that find a library by one header. */
#ifndef COGLESS_H
#define COGLESS_H

#include "cogless/angle.h"
#include "cogless/anti_cogging.h"
#include "cogless/crc32.h"
#include "cogless/drive.h"
#include "cogless/feedforward.h"
#include "cogless/foc.h"
#include "cogless/map.h"
#include "cogless/map_store.h"
#include "cogless/memory.h"
#include "cogless/modulation.h"
#include "cogless/monitor.h"
#include "cogless/pi.h"
#include "cogless/pi_afc.h"
#include "cogless/pi_ilc.h"
#include "cogless/polynomial.h"
#include "cogless/quality.h"
#include "cogless/robust_ilc.h"
#include "cogless/space_position.h"
#include "cogless/space_speed.h"
#include "cogless/speed_pi.h"
#include "cogless/transform.h"
#include "cogless/trial.h"
#include "cogless/version.h"
#include "cogless/zero_phase.h"

#endif
