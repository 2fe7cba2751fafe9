#include "guard.h"

#define BAR CGL_R(1.18)      /* A window above this multiple of the bar is bad. Equal windows differ by less. The promise is 1.56. */
#define LOUD CGL_R(16.0)     /* A burst is a ripple of this multiple of the bar, or four times the bar's rms. It ends its window at once. */
#define SHORTEST CGL_R(0.25) /* shortest window [s]: twenty windows take the 5 s that are promised */
#define LONGEST CGL_R(2.5)   /* longest window [s]: a slower rotor is judged in parts of a turn */
#define FIRST CGL_R(1.0)     /* longest window of START [s]: a slow rotor does not wait for a whole turn, and LEARN gives its bar. */
#define RAMP CGL_R(0.5)      /* time in which the share goes from 0 to 1 [s]: the feedback's integral has to take over a learned load */
#define SOON 16U             /* windows of LEARN before the first test. With those of two tests harm acts for about the promised 20. */
#define RARE 1024U           /* largest distance between tests [windows], at which the three windows of a test are 0.3 % of the time */
#define WEIGHT 8U            /* A test comes due this many times more slowly while learning halves the ripple's amplitude. */
#define GUILT 4U             /* counts of evidence that convict: a test gives 2, as one test may be chance; a HOLD that helped gives 1 */
#define BLATANT CGL_R(4.0)   /* One test convicts if P(0) is below P(1) / BLATANT, but not if P(1) is the ripple of a burst. */

const cgl_gentle cgl_gentle_steps[CGL_GUARD_STEPS + 1U] = {
    {CGL_REAL_MAX, CGL_R(1.0), CGL_R(1.0)}, {CGL_R(1.01), CGL_R(1.0), CGL_R(1.0)}, {CGL_R(0.5), CGL_R(1.0), CGL_R(0.98)},
    {CGL_R(0.5), CGL_R(0.5), CGL_R(0.95)},  {CGL_R(0.5), CGL_R(0.25), CGL_R(0.9)}, {CGL_R(0.5), CGL_R(0.0625), CGL_R(0.8)},
    {CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)}};

/* Share of the learned current that acts in each phase. */
static const cgl_real phase_share[] = {CGL_R(1.0), CGL_R(1.0), CGL_R(1.0), CGL_R(0.75), CGL_R(0.0), CGL_R(0.0), CGL_R(0.0)};

static cgl_real larger(cgl_real a, cgl_real b)
{
    return a > b ? a : b;
}

/* Goes to a phase. The error swings after a new share: an infinite last ripple makes the next window count as not calm. */
CGL_SELDOM static void go_to(cgl_guard *guard, cgl_guard_phase phase, uint8_t bad)
{
    guard->phase = (uint8_t)phase;
    guard->ripple = phase > CGL_GUARD_HOLD ? CGL_REAL_MAX : guard->ripple;
    guard->age = 0U;
    guard->bad = bad;
}

CGL_SELDOM void cgl_guard_reset(cgl_guard *guard)
{
    static const cgl_guard start = {.share = CGL_R(1.0), .gentle = 1U, .patience = SOON, .retry = 4U * SOON, .ripple = CGL_REAL_MAX};
    const cgl_real ts = guard->ts;
    *guard = start;
    guard->ts = ts;
}

CGL_SELDOM cgl_error cgl_guard_init(cgl_guard *guard, cgl_real ts)
{
    guard->ts = ts;
    cgl_guard_reset(guard);
    return cgl_is_positive(ts) ? CGL_OK : CGL_ERROR_CONFIG;
}

/* Begins a window of whole turns of the reference. FORGET has a longer one, to pass each cell, also those that a Q filter waits for. */
CGL_SELDOM static void begin_window(cgl_guard *guard, cgl_real omega_ref)
{
    const bool clears = cgl_guard_forgets(guard);
    const cgl_real longest = clears ? CGL_R(40.0) * LONGEST : (guard->phase == (uint8_t)CGL_GUARD_START ? FIRST : LONGEST);
    const cgl_real turn = CGL_TWO_PI / larger(cgl_abs(omega_ref), CGL_TWO_PI / longest);
    const cgl_real more = SHORTEST / turn; /* turns in the shortest window; the count is limited for a very fast rotor */
    const cgl_real turns = clears ? CGL_R(1.6) : (more < CGL_R(1.0e6) ? (cgl_real)(1U + (uint32_t)more) : CGL_R(1.0e6));
    const cgl_real samples = turns * turn / guard->ts;
    guard->length = samples < CGL_R(1.0e9) ? 1U + (uint32_t)samples : 1000000000U;
    guard->count = guard->limited = 0U;
    guard->squares = guard->fast = CGL_R(0.0);
}

/* Clears what is learned. Learns more gently, by two steps if the last conviction was not long ago, else by one. A table that no
 * law is learning stays as it is, but does not act for a while. */
CGL_SELDOM static void convict(cgl_guard *guard, bool learn)
{
    const bool learns = learn && guard->taught;
    const uint32_t gentle = guard->gentle + (guard->good < 2U * SOON ? 2U : 1U);
    guard->gentle = learns && gentle < CGL_GUARD_STEPS ? gentle : CGL_GUARD_STEPS;
    guard->retry = guard->retry < 4U * RARE ? 2U * guard->retry : guard->retry;
    guard->good = guard->evidence = 0U;
    guard->patience = SOON;
    guard->taught = false;
    go_to(guard, learns ? CGL_GUARD_FORGET : CGL_GUARD_MUTE, 0U);
}

/* Begins a test after a burst, two bad windows, or enough time. Time counts less while learning halves the ripple's amplitude, if the
 * ripple is no worse than in the last test. While the current loop falls short, only time counts, as learning need not be the cause. */
CGL_SELDOM static void judge_learning(cgl_guard *guard, cgl_real v, cgl_real speed, bool loud)
{
    if (guard->good >= guard->retry && guard->gentle > 1U) {
        --guard->gentle;
        guard->good = 0U;
    }
    const bool excused = guard->limited > guard->length / 8U;
    const bool elsewhere = guard->speed < CGL_REAL_MAX && !cgl_is_within(speed - cgl_abs(guard->speed), CGL_R(0.25) * speed);
    const uint32_t soon = guard->taught ? SOON : SOON / 4U; /* A table that nobody learns acted while the bar was measured: test soon. */
    const uint32_t patience = (elsewhere || guard->patience == SOON) && guard->patience > soon ? soon : guard->patience;
    const bool gains = v < CGL_R(0.25) * guard->alone && !(v > BAR * guard->acting);
    guard->age += excused ? patience / 2U : (gains ? 1U : WEIGHT);
    guard->evidence = guard->age >= (gains ? WEIGHT : SOON * WEIGHT) ? 0U : guard->evidence;
    guard->bad = (uint8_t)(v > BAR * guard->alone && !excused ? guard->bad + 1U : 0U);
    if (loud || guard->bad >= 2U || guard->age >= patience * WEIGHT) {
        go_to(guard, CGL_GUARD_HOLD, loud ? 2U : guard->bad);
    }
}

/* Judges a window of HOLD. If the window is no longer bad, learning itself made the ripple. If it still is, what is learned may make the
 * ripple, and ALONE takes it away to see. Without a suspicion the cheap test PART comes first. */
CGL_SELDOM static void judge_holding(cgl_guard *guard, cgl_real v, const cgl_guard_input *in, bool loud, bool calm)
{
    if (guard->bad > 0U && !loud && !(v > BAR * guard->alone)) {
        ++guard->evidence;
        if (guard->evidence >= GUILT) {
            convict(guard, in->learn);
        } else {
            go_to(guard, CGL_GUARD_LEARN, 0U);
        }
    } else if (calm || loud) {
        guard->acting = v;
        guard->speed = in->omega_ref;
        guard->share = loud ? CGL_R(0.0) : guard->share; /* A burst leaves no time for a ramp. */
        go_to(guard, guard->bad > 0U ? CGL_GUARD_ALONE : CGL_GUARD_PART, (uint8_t)(loud ? 0U : 1U));
    } else { /* The ripple still falls. */
    }
}

/* Judges a window of a test. Only a settled window may raise the bar. Where the reference moved, the rotor stalls or the current loop
 * falls short, the parabola need not hold: the bar stays, and evidence counts half. In the last two cases PART acquits only what helps. */
CGL_SELDOM static void judge_test(cgl_guard *guard, cgl_real v, const cgl_guard_input *in, bool calm, bool stalls)
{
    const cgl_real share = phase_share[guard->phase], bound = (v - share * guard->acting) / (CGL_R(1.0) - share);
    const bool part = share > CGL_R(0.0), harms = guard->acting > BAR * bound;
    const cgl_real alone = part ? larger(bound, guard->acting) : v;
    const bool moved = !cgl_is_within(in->omega_ref - guard->speed, CGL_R(0.1) * cgl_abs(guard->speed));
    const bool weak = stalls || guard->limited > guard->length / 8U, unlike = moved || weak;
    if (part && (harms || (weak && !(v > BAR * guard->acting)))) {
        go_to(guard, CGL_GUARD_ALONE, 1U);
        return;
    }
    if (!calm && (part ? alone > BAR * guard->alone && guard->acting > guard->alone : !harms)) {
        return;
    }
    guard->alone = !unlike && (calm || alone < BAR * guard->alone) ? alone : guard->alone;
    guard->speed = moved ? CGL_REAL_MAX : guard->speed;
    if (part || !harms) {
        guard->patience = guard->patience < RARE ? 2U * guard->patience : RARE;
        guard->evidence = 0U;
        go_to(guard, CGL_GUARD_LEARN, 0U);
        return;
    }
    guard->evidence = (uint8_t)(guard->evidence + (unlike ? 1U : (guard->bad > 0U && guard->acting > BLATANT * v ? GUILT : 2U)));
    if (guard->evidence >= GUILT) {
        convict(guard, in->learn);
    } else {
        go_to(guard, CGL_GUARD_HOLD, 2U);
    }
}

/* Measures the bar while nothing learned acts. Two windows that agree give the bar. If a table acted in them, its test comes soon. */
CGL_SELDOM static void judge_feedback(cgl_guard *guard, cgl_real v, const cgl_guard_input *in, bool calm)
{
    const bool part = guard->phase == (uint8_t)CGL_GUARD_START && cgl_abs(in->omega_ref) * FIRST < CGL_TWO_PI;
    guard->alone = part ? CGL_R(0.0) : v;
    guard->acting = v;
    guard->speed = in->omega_ref;
    if (!calm || (guard->gentle == CGL_GUARD_STEPS && guard->good < guard->retry)) {
        return;
    }
    guard->gentle -= guard->gentle == CGL_GUARD_STEPS ? 1U : 0U;
    guard->patience = SOON;
    go_to(guard, CGL_GUARD_LEARN, 0U);
}

/* The fast ripple counts only beyond that of the feedback alone, which is mostly encoder counts. The mean error counts too if the rotor
 * does not turn with its reference. A law that learned from the start takes its bar from one window, in which it had learned little.
 * While nothing is learned, the first windows may lower the bar, as a start swings. */
CGL_SELDOM static void end_window(cgl_guard *guard, const cgl_guard_input *in, bool loud)
{
    const cgl_real speed = cgl_abs(in->omega_ref), n = (cgl_real)guard->count, fast = guard->fast / n;
    const cgl_real stalled = cgl_is_within(guard->mean, CGL_R(0.5) * speed) ? CGL_R(0.0) : guard->mean * guard->mean;
    const cgl_real slow = guard->squares / n + stalled + CGL_R(1.0e-20);
    const bool begins = !guard->taught && guard->good < SOON / 4U && slow < guard->alone;
    const bool blind = guard->phase == (uint8_t)CGL_GUARD_LEARN && (begins || !(guard->alone > CGL_R(0.0)));
    const bool acts = !blind && (guard->phase == (uint8_t)CGL_GUARD_LEARN || guard->phase == (uint8_t)CGL_GUARD_HOLD);
    const cgl_real v = slow + (acts ? larger(fast - BAR * guard->noise, CGL_R(0.0)) : CGL_R(0.0));
    const bool calm = !(v < CGL_R(0.5) * guard->ripple);
    guard->noise = acts || guard->phase == (uint8_t)CGL_GUARD_PART ? guard->noise : fast;
    guard->ripple = v;
    guard->good += guard->good < 8U * RARE ? 1U : 0U;
    switch (guard->phase) {
    case CGL_GUARD_LEARN:
        if (blind) {
            judge_feedback(guard, v, in, true);
        } else {
            judge_learning(guard, v, speed, loud);
        }
        break;
    case CGL_GUARD_HOLD:
        judge_holding(guard, v, in, loud, calm);
        break;
    case CGL_GUARD_PART:
    case CGL_GUARD_ALONE:
        judge_test(guard, v, in, calm, stalled > CGL_R(0.0));
        break;
    case CGL_GUARD_FORGET:
        go_to(guard, CGL_GUARD_MUTE, 0U);
        break;
    default:
        judge_feedback(guard, v, in, calm);
        break;
    }
    guard->length = 0U;
}

/* Moves the share to that of the phase. If the rotor is at its reference in the very first sample, there is no run-up: LEARN begins. */
CGL_SELDOM static void fade_share(cgl_guard *guard, const cgl_guard_input *in)
{
    const bool first = guard->phase == (uint8_t)CGL_GUARD_START && !(guard->ripple < CGL_REAL_MAX);
    if (first && cgl_is_within(in->error, CGL_R(0.1) * cgl_abs(in->omega_ref))) {
        go_to(guard, CGL_GUARD_LEARN, 0U);
    }
    const cgl_real rest = phase_share[guard->phase] - guard->share, step = guard->ts / RAMP;
    if (cgl_is_within(rest, step)) {
        guard->share = phase_share[guard->phase];
        begin_window(guard, in->omega_ref);
    } else {
        guard->share += cgl_clamp(rest, step);
    }
}

void cgl_guard_step(cgl_guard *guard, const cgl_guard_input *in)
{
    if (!CGL_OFTEN(in->plausible && cgl_is_within(in->error, CGL_R(1.0e12)))) {
        return;
    }
    if (!CGL_OFTEN(guard->length > 0U)) {
        fade_share(guard, in);
    }
    const cgl_real half = CGL_R(0.5) * (in->error - guard->last_error), x = in->error - half - guard->mean;
    const cgl_real corner = guard->ts * larger(cgl_abs(in->omega_ref), CGL_R(1.0));
    guard->last_error = in->error;
    guard->mean += (corner < CGL_R(1.0) ? corner : CGL_R(1.0)) * x;
    guard->squares += x * x;
    guard->fast += half * half;
    guard->taught = guard->taught || in->learned;
    if (guard->limited <= guard->length / 8U) {
        guard->limited = in->saturated ? guard->limited + 1U : 0U;
    }
    ++guard->count;
    const bool acts = guard->phase == (uint8_t)CGL_GUARD_LEARN || guard->phase == (uint8_t)CGL_GUARD_HOLD;
    const bool known = guard->limited == 0U && guard->alone > CGL_R(0.0);
    const bool loud = acts && known && guard->squares > LOUD * guard->alone * (cgl_real)guard->length;
    if (guard->length > 0U && (guard->count >= guard->length || loud)) {
        end_window(guard, in, loud);
    }
}
