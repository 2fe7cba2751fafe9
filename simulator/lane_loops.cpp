// Compiled once for each set of instructions and each number type of the laws, with COGLESS_LANES as the instructions' type (wide.hpp),
// and the instructions enabled. It may define nothing else that runs elsewhere; see lane_step.hpp.
#include "lane_loops.hpp"

#include <cstring>
#include <iterator>
#include <limits>
#include <utility>

#include "cogless/status.h"

// Here are several numbers the cgl_real of the control library, with the words of its choice.h.
#define COGLESS_CHOICE_H

namespace cogless {

namespace {

using Number = ::cgl_real;
using Lanes = COGLESS_LANES;
constexpr std::size_t doubles = sizeof(Lanes::Register) / sizeof(double), fitting = sizeof(Lanes::Register) / sizeof(Number);
// As many lanes as a register has, and the same lanes as doubles.
using Real = Wide<(fitting < Lanes::lanes ? fitting : Lanes::lanes), 1, Number>;
using Double = Wide<doubles, Real::lanes / doubles>;

constexpr auto each = std::make_index_sequence<Real::lanes>();

using cgl_real = Real;
using cgl_truth = Real::Mask;
#define CGL_CHOICE(condition, yes, no) select(condition, yes, no)

[[gnu::always_inline]] inline Real cgl_abs(const Real& x) {
    Real size;
    size.part[0] = reinterpret_cast<Real::Register>(reinterpret_cast<Real::Bits>(x.part[0]) & std::numeric_limits<Real::Integer>::max());
    return size;
}

[[gnu::always_inline]] inline cgl_truth cgl_is_within(const Real& x, const Real& limit) { return cgl_abs(x) <= limit; }

[[gnu::always_inline]] inline Real cgl_clamp(const Real& x, const Real& limit) {
    const Real zero = Number(0);
    return select(cgl_is_within(x, limit), x, select(x > zero, limit, select(x < zero, -limit, zero)));
}

[[gnu::always_inline]] inline Real cgl_clamp_here(const Real& x, const Real& limit) { return cgl_clamp(x, limit); }

struct cgl_phasor {
    Real cosine, sine;
};

[[gnu::always_inline]] inline cgl_phasor cgl_product(const cgl_phasor& a, const cgl_phasor& b) {
    return {a.cosine * b.cosine - a.sine * b.sine, a.cosine * b.sine + a.sine * b.cosine};
}

[[gnu::always_inline]] inline Real cgl_add(const Real& sum, const Real& x, const Real& limit, Real* lost) {
    const Real term = x + *lost, result = sum + term;
    *lost = select(cgl_is_within(result, limit), term - (result - sum), Number(0));
    return cgl_clamp(result, limit);
}

[[gnu::always_inline]] inline cgl_truth operator&&(const cgl_truth& a, const cgl_truth& b) { return a & b; }
[[gnu::always_inline]] inline cgl_truth operator||(bool all, const cgl_truth& each) { return all ? !cgl_truth{} : each; }
[[gnu::always_inline]] inline cgl_truth cgl_is_in_turn(const Real& theta) { return (theta >= Number(0)) & (theta < CGL_TWO_PI); }

#include "cogless/duties.h"
#include "cogless/foc.h"
#include "cogless/foc_parts.h"
#include "cogless/harmonic_parts.h"
#include "cogless/monitor.h"
#include "cogless/monitor_parts.h"
#include "cogless/transform.h"

template <class Wide>
[[gnu::always_inline]] inline Wide& at(auto& numbers, std::size_t lane) {
    return *reinterpret_cast<Wide*>(&numbers[lane]);
}

// A number of each lane's array.
template <std::size_t... lane>
[[gnu::always_inline]] inline Real gathered(const Number* const* of, std::size_t n, std::index_sequence<lane...>) {
    Real all;
    all.part[0] = Real::Register{of[lane][n]...};
    return all;
}

// The lanes of a Wide whose bits are set.
template <class Wide, std::size_t... lane>
[[gnu::always_inline]] inline typename Wide::Mask mask_of(std::uint32_t set, std::index_sequence<lane...>) {
    typename Wide::Mask mask;
    for (std::size_t r = 0; r < std::size(mask.bits); ++r) {
        const auto own = static_cast<typename Wide::Integer>(set >> (r * sizeof...(lane)));
        mask.bits[r] = ((typename Wide::Bits{} + own) & typename Wide::Bits{(1 << lane)...}) != 0;
    }
    return mask;
}

[[gnu::always_inline]] inline Double as_doubles(const Real& x) {
    typedef Number Part __attribute__((vector_size(sizeof(Number) * doubles)));
    Part part[Real::lanes / doubles];
    std::memcpy(part, &x, sizeof x);
    Double all;
    for (std::size_t r = 0; r < std::size(part); ++r) all.part[r] = __builtin_convertvector(part[r], Double::Register);
    return all;
}

// These registers as one. If they went through the memory, the processor would wait until both are written.
template <class Part>
[[gnu::always_inline]] inline Part joined(const Part (&part)[1], auto) { return part[0]; }
template <class Part, std::size_t... lane>
[[gnu::always_inline]] inline auto joined(const Part (&part)[2], std::index_sequence<lane...>) {
    return __builtin_shufflevector(part[0], part[1], lane...);
}

[[gnu::always_inline]] inline Real as_reals(const Double& x) {
    typedef Number Part __attribute__((vector_size(sizeof(Number) * doubles)));
    Part part[Real::lanes / doubles];
    for (std::size_t r = 0; r < std::size(part); ++r) part[r] = __builtin_convertvector(x.part[r], Part);
    Real all;
    all.part[0] = joined(part, each);
    return all;
}

[[gnu::always_inline]] inline const Double& at(const double* numbers, std::size_t lane) {
    return *reinterpret_cast<const Double*>(numbers + lane);
}

// Writes a new number of these lanes, and returns the numbers before.
[[gnu::always_inline]] inline Real take(LaneLoops::Reals& numbers, std::size_t first, const cgl_truth& lanes, const Real& next) {
    Real& all = at<Real>(numbers, first);
    const Real before = all;
    all = select(lanes, next, before);
    return before;
}

// Steps the current loops of these lanes, from `first` on, and returns those that have stepped.
[[gnu::always_inline]] inline cgl_truth step(LaneLoops& l, std::size_t first, const cgl_foc_input& in, const cgl_truth& asked) {
    cgl_foc foc;
    foc.config.kp_d = at<Real>(l.kp_d, first);
    foc.config.kp_q = at<Real>(l.kp_q, first);
    foc.config.L_d = at<Real>(l.L_d, first);
    foc.config.L_q = at<Real>(l.L_q, first);
    foc.config.psi_f = at<Real>(l.psi_f, first);
    foc.config.decoupling = l.decoupling;
    foc.rise_d = at<Real>(l.rise_d, first);
    foc.rise_q = at<Real>(l.rise_q, first);
    foc.integral_d = at<Real>(l.integral_d, first);
    foc.integral_q = at<Real>(l.integral_q, first);
    foc.lost_d = at<Real>(l.lost_d, first);
    foc.lost_q = at<Real>(l.lost_q, first);

    const cgl_vector i = cgl_foc_currents(&in, l.two_phases, at<Real>(l.sine, first), at<Real>(l.cosine, first));
    const cgl_vector ref = {in.i_d_ref, in.i_q_ref};
    const cgl_vector error = {ref.d - i.d, ref.q - i.q};
    const cgl_vector u = cgl_foc_voltage(&foc, in.omega_e, i, error);
    const Real per_bus = Real(Number(1)) / in.u_dc, longest = cgl_foc_longest(l.two_phases);
    const cgl_vector part = {u.d * per_bus, u.q * per_bus};
    const cgl_truth free = (in.u_dc >= CGL_BUS_MIN) & cgl_is_within(in.u_dc, CGL_REAL_MAX) &
                           cgl_is_shorter(ref, at<Real>(l.current_limit, first)) & cgl_is_shorter(part, longest);
    cgl_foc_integrate(&foc, error, in.u_dc * longest);
    Real duty[3];
    cgl_foc_duties(part, l.two_phases, at<Real>(l.acting_sine, first), at<Real>(l.acting_cosine, first), duty);

    const cgl_truth takes = asked & free;
    take(l.integral_d, first, takes, foc.integral_d);
    take(l.integral_q, first, takes, foc.integral_q);
    take(l.lost_d, first, takes, foc.lost_d);
    take(l.lost_q, first, takes, foc.lost_q);
    const Double least = at<Double>(l.least_duty, first);
    const cgl_truth late = at<Real>(l.delayed, first) > Real(Number(0));
    const auto acting = as_doubles(select(takes, Real(Number(1)), Real(Number(0)))) > Double(0.0);
    for (std::size_t n = 0; n < 3; ++n) {
        const Real before = take(l.computed[n], first, takes, duty[n]);
        const Double acts = as_doubles(select(late, before, duty[n]));
        Double& all = *reinterpret_cast<Double*>(l.duty[n] + first);
        all = select(acting, select(acts < least, Double(0.0), select(acts > 1.0 - least, Double(1.0), acts)), all);
    }
    const Real output[] = {duty[0], duty[1], duty[2], i.d, i.q, u.d, u.q, ref.d, ref.q};
    for (std::size_t n = 0; n < std::size(output); ++n) take(l.output[n], first, takes, output[n]);
    return takes;
}

[[gnu::always_inline]] inline std::uint32_t step_some(LaneLoops& l, std::size_t first, std::uint32_t lanes) {
    const Number* const* from = l.in.of + first;
    const auto input = [&](std::size_t n) __attribute__((always_inline)) { return gathered(from, n, each); };
    const cgl_foc_input in = {{input(0), input(1), input(2)}, Number(0), input(4), input(5), input(6), input(7)};
    return step(l, first, in, mask_of<Real>(lanes, each)).packed();
}

[[gnu::always_inline]] inline std::uint32_t step_some_quietly(LaneLoops& l, std::size_t first, std::uint32_t lanes) {
    const Double sum = ((at(l.states[0], first) + at(l.states[1], first)) + at(l.states[2], first)) + at(l.states[3], first);
    const Real finite = as_reals(select(magnitude(sum) <= std::numeric_limits<double>::max(), Double(1.0), Double(0.0)));
    cgl_monitor monitor;
    monitor.config.phases = l.monitor_phases;
    monitor.limits.travel_square = at<Real>(l.travel_square, first);
    monitor.limits.speed_square = at<Real>(l.speed_square, first);
    monitor.limits.current_square = at<Real>(l.current_square, first);
    monitor.limits.sum_square = at<Real>(l.sum_square, first);
    const Real theta = at<Real>(l.theta_m, first), omega = at<Real>(l.omega_m, first), u_dc = at<Real>(l.u_dc, first);
    const Real zero = Number(0);
    const cgl_foc_input in = {{as_reals(at(l.measured[0], first)), as_reals(at(l.measured[1], first)), as_reals(at(l.measured[2], first))},
                              zero,
                              at<Real>(l.pole_pairs, first) * omega,
                              u_dc,
                              at<Real>(l.i_d_ref, first),
                              at<Real>(l.i_q_ref, first)};
    const Real d = theta - at<Real>(l.theta_sensor, first);
    const cgl_truth stands = (d <= zero) & (d >= zero);
    const Real turned = at<Real>(l.ref_turned, first) + at<Real>(l.omega_ref, first) * at<Real>(l.period, first);
    const Real ref_turned = select(stands, turned, zero);
    cgl_truth ordinary = mask_of<Real>(lanes, each) & (finite > zero) & cgl_is_rotor_ordinary(&monitor, theta, d, omega) &
                         (ref_turned * ref_turned <= at<Real>(l.doubt_square, first));
    if (l.monitor_phases != 0U) ordinary = ordinary & cgl_are_currents_ordinary(&monitor, in.i_abc, u_dc);
    const cgl_truth takes = step(l, first, in, ordinary);
    take(l.theta_sensor, first, takes, theta);
    take(l.ref_turned, first, takes, ref_turned);
    return takes.packed();
}

[[gnu::always_inline]] inline std::uint32_t watch_some(LaneLoops& l, std::size_t first, const double* theta_m, std::uint32_t lanes) {
    const Double& theta = at(theta_m, first);
    const Double::Mask stays = mask_of<Double>(lanes, std::make_index_sequence<doubles>()) & (theta >= at<Double>(l.theta_low, first)) &
                               (theta < at<Double>(l.theta_high, first));
    Double& before = at<Double>(l.theta_before, first);
    before = select(stays, theta, before);
    return stays.packed();
}

using Square = Real::Register[Real::lanes];

// a[from], b[from], a[from + 1], b[from + 1], ...
template <std::size_t from, std::size_t... n>
[[gnu::always_inline]] inline Real::Register zipped(const Real::Register& a, const Real::Register& b, std::index_sequence<n...>) {
    return __builtin_shufflevector(a, b, (from + n / 2 + n % 2 * Real::lanes)...);
}

// Transposes the rows. Of n rows it takes log2(n) steps; each zips the first half of the rows with the second half.
template <std::size_t step = 1, std::size_t... n>
[[gnu::always_inline]] inline void transpose(Square& rows, std::index_sequence<n...> all) {
    constexpr std::size_t half = Real::lanes / 2;
    const Square zips = {zipped<n % 2 * half>(rows[n / 2], rows[n / 2 + half], all)...};
    ((rows[n] = zips[n]), ...);
    if constexpr (step < half) transpose<2 * step>(rows, all);
}

// Calls f(at) for blocks of as many numbers as there are lanes, from `at` on, that cover `begin` to before `end`. The last block ends at
// `end`, so it may start before `begin`. Returns false, and calls nothing, if `end` is less than a block.
template <class F>
[[gnu::always_inline]] inline bool blocks(std::uint32_t begin, std::uint32_t end, const F& f) {
    constexpr std::uint32_t size = Real::lanes;
    if (end < size) return false;
    for (; begin < end; begin += size) f(begin < end - size ? begin : end - size);
    return true;
}

// Numbers from `begin` to before `end` of each lane's array.
[[gnu::always_inline]] inline void read(const Number* const* of, std::uint32_t begin, std::uint32_t end, Real* all) {
    const bool in_blocks = blocks(begin, end, [&](std::uint32_t at) __attribute__((always_inline)) {
        Square rows;
        for (std::size_t lane = 0; lane < Real::lanes; ++lane) std::memcpy(&rows[lane], of[lane] + at, sizeof rows[lane]);
        transpose(rows, each);
        for (std::size_t n = 0; n < Real::lanes; ++n) all[at + n].part[0] = rows[n];
    });
    for (; !in_blocks && begin < end; ++begin) all[begin] = gathered(of, begin, each);
}

// Writes numbers from `begin` to before `end` into each lane's array. It may also write some before `begin`, which must be as they were
// read.
[[gnu::always_inline]] inline void write(Number* const* of, std::uint32_t begin, std::uint32_t end, const Real* all) {
    const bool in_blocks = blocks(begin, end, [&](std::uint32_t at) __attribute__((always_inline)) {
        Square rows;
        for (std::size_t n = 0; n < Real::lanes; ++n) rows[n] = all[at + n].part[0];
        transpose(rows, each);
        for (std::size_t lane = 0; lane < Real::lanes; ++lane) std::memcpy(of[lane] + at, &rows[lane], sizeof rows[lane]);
    });
    for (; !in_blocks && begin < end; ++begin) {
        for (std::size_t lane = 0; lane < Real::lanes; ++lane) of[lane][begin] = all[begin][lane];
    }
}

[[gnu::always_inline]] inline void sum_some(LaneOrders& o, std::size_t first) {
    Real cosine[CGL_HARMONIC_ORDERS], sine[CGL_HARMONIC_ORDERS], gain[2 * CGL_HARMONIC_ORDERS];
    read(o.cosine.of + first, 0, o.acting, cosine);
    read(o.sine.of + first, 0, o.acting, sine);
    read(o.gain.of + first, 2 * o.begin, 2 * o.end, gain);
    read(o.gain.of + first, 2 * o.low, 2 * o.acting, gain);
    const cgl_phasor lowest = {at<Real>(o.first_cosine, first), at<Real>(o.first_sine, first)};
    cgl_orders orders = {cosine, sine, gain, o.begin, o.end, o.low, o.acting, lowest, at<Real>(o.loads, first), at<Real>(o.error, first),
                         at<Real>(o.limit, first), at<Real>(o.phase_sum, first)};
    at<Real>(o.sum, first) = cgl_sum_of_orders(&orders);
    at<Real>(o.phase_sum, first) = orders.phase_sum;
    write(o.cosine.of + first, o.begin, o.end, cosine);
    write(o.sine.of + first, o.begin, o.end, sine);
    write(o.cosine.of + first, o.low, o.acting, cosine);
    write(o.sine.of + first, o.low, o.acting, sine);
}

// Calls f(first, lanes) for the lanes of one register after the other.
template <class F>
[[gnu::always_inline]] inline std::uint32_t registers(std::uint32_t lanes, const F& f) {
    std::uint32_t done = 0;
    for (std::size_t first = 0; first < Lanes::lanes; first += Real::lanes) done |= f(first, lanes >> first) << first;
    return done;
}

}  // namespace

template <>
void sum_orders<Lanes>(LaneOrders& orders) {
    for (std::size_t first = 0; first < Lanes::lanes; first += Real::lanes) sum_some(orders, first);
}

template <>
std::uint32_t step_loops<Lanes>(LaneLoops& loops, std::uint32_t lanes) {
    return registers(lanes, [&](std::size_t first, std::uint32_t some)
                                __attribute__((always_inline)) { return step_some(loops, first, some); });
}

template <>
std::uint32_t step_quietly<Lanes>(LaneLoops& loops, std::uint32_t lanes) {
    return registers(lanes, [&](std::size_t first, std::uint32_t some)
                                __attribute__((always_inline)) { return step_some_quietly(loops, first, some); });
}

template <>
std::uint32_t watch<Lanes>(LaneLoops& loops, const double* theta_m, std::uint32_t lanes) {
    return registers(lanes, [&](std::size_t first, std::uint32_t some)
                                __attribute__((always_inline)) { return watch_some(loops, first, theta_m, some); });
}

}  // namespace cogless
