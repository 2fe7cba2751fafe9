// References as functions of time: the speed, its integral (the angle) and its derivative, each in closed form, so that nothing
// drifts even over an hour. A filter may smooth the speed.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "maths.hpp"
#include "table.hpp"

namespace cogless {

enum class ReferenceKind { constant, ramp, profile, sine, fm, sines, moves };

struct Sine {
    double amplitude, frequency, phase;  // rad/s, Hz, rad
};

struct ReferenceConfig {
    ReferenceKind kind = ReferenceKind::constant;
    double speed = 0.0;      // rad/s, the constant speed, or the one at the end of a ramp
    double ramp = 0.0;       // rad/s^2, from the initial speed
    Table profile;           // rad/s over s
    double offset = 0.0, amplitude = 0.0, frequency = 0.0;  // sine, fm, sines: rad/s, rad/s, Hz
    double depth = 0.0, modulation = 0.0;                   // fm: rad, Hz
    std::vector<Sine> sines;                                // sines, besides the offset
    Table moves;             // rad over s; only differences of the angles count
    double smoothing = 0.0;  // s, both time constants of the filter on the speed; 0: none
};

// State of a reference: rad, not wrapped; rad/s; rad/s^2.
struct Motion {
    double theta = 0.0, omega = 0.0, alpha = 0.0;
};

inline double turns_per_second(double frequency) { return 2.0 * std::numbers::pi * frequency; }

// The integral of amplitude sin(omega t + phase) from 0 on.
inline double integral_of_sine(const Sine& s, double time) {
    const double omega = turns_per_second(s.frequency);
    if (omega == 0.0) return s.amplitude * sine(s.phase) * time;
    return s.amplitude * (cosine(s.phase) - cosine(omega * time + s.phase)) / omega;
}

// The integral from 0 on of sin(omega t + depth sin(m t)), the sum over n of J_n(depth) sin((omega + n m) t) (Jacobi, Anger).
class IntegralOfFm {
public:
    IntegralOfFm() = default;

    // Throws std::invalid_argument for a depth that takes too many terms.
    explicit IntegralOfFm(const ReferenceConfig& r)
        : omega_(turns_per_second(r.frequency)), m_(turns_per_second(r.modulation)) {
        const double depth = std::abs(r.depth);
        if (!(depth <= 100.0)) throw std::invalid_argument("reference.depth: expected at most 100 rad");
        const std::vector<double> bessel_functions = bessel_j(static_cast<std::size_t>(2.0 * depth) + 40, depth);
        for (int n = 0;; ++n) {
            const double bessel = bessel_functions[static_cast<std::size_t>(n)];
            if (n > depth && bessel < 1e-18) break;
            const double odd = n % 2 == 0 ? 1.0 : -1.0, sign = r.depth < 0.0 ? odd : 1.0;
            above_.push_back(weight(sign * bessel, n));
            below_.push_back(n == 0 ? 0.0 : weight(sign * odd * bessel, -n));
            at_zero_ += above_.back() + below_.back();
        }
    }

    double at(double time) const {
        const Complex<double> step = unit_vector(m_ * time), back = {step.re, -step.im};
        Complex<double> above = unit_vector(omega_ * time), below = above;
        double sum = at_zero_;
        for (std::size_t n = 0; n < above_.size(); ++n) {
            sum -= above_[n] * above.re + below_[n] * below.re;
            above = above * step;
            below = below * back;
        }
        return sum;
    }

private:
    double weight(double bessel, int n) const {
        const double omega = omega_ + n * m_;
        return std::abs(omega) > 1e-12 * (std::abs(omega_) + std::abs(m_)) ? bessel / omega : 0.0;
    }

    double omega_ = 0.0, m_ = 0.0;  // rad/s
    std::vector<double> above_, below_;  // coefficients of the cosines at omega + n m and omega - n m
    double at_zero_ = 0.0;
};

class Reference {
public:
    // State of the smoothing filter, and its input speed at the last sample.
    struct State {
        double omega = 0.0, alpha = 0.0, unfiltered = 0.0;
        bool started = false;
    };

    // period: s, of the samples. Throws std::invalid_argument for a reference without a closed form, or a filter that is too
    // fast for the samples.
    Reference(const ReferenceConfig& config, double initial_angle, double initial_speed, double period)
        : config_(config), initial_angle_(initial_angle), initial_speed_(initial_speed), period_(period) {
        if (config.kind == ReferenceKind::fm) fm_ = IntegralOfFm(config);
        const Table& profile = config.profile;
        for (std::size_t n = 0; n < profile.at.size(); ++n) {
            area_.push_back(n == 0 ? 0.0
                                   : area_.back() + 0.5 * (profile.value[n - 1] + profile.value[n]) *
                                                        (profile.at[n] - profile.at[n - 1]));
        }
        if (config.kind == ReferenceKind::profile) area_at_start_ = profile_area(0.0);
        if (config.kind == ReferenceKind::moves) angle_at_start_ = move(0.0).theta;
        if (config.smoothing != 0.0) set_filter();
    }

    State start() const { return {initial_speed_, 0.0, 0.0, false}; }

    // The next sample, at this time; the first one is at time zero.
    Motion sample(State& s, double time) const {
        Motion m = at(time);
        if (config_.smoothing != 0.0) {
            if (s.started) {
                const double middle = at(time - 0.5 * period_).omega;
                const State old = s;
                s.omega = to_omega_[0] * old.omega + to_omega_[1] * old.alpha + to_omega_[2] * old.unfiltered +
                          to_omega_[3] * middle + to_omega_[4] * m.omega;
                s.alpha = to_alpha_[0] * old.omega + to_alpha_[1] * old.alpha + to_alpha_[2] * old.unfiltered +
                          to_alpha_[3] * middle + to_alpha_[4] * m.omega;
            }
            s.started = true;
            s.unfiltered = m.omega;
            // the integral of tau^2 omega'' + 2 tau omega' + omega = unfiltered
            const double tau = config_.smoothing;
            m = {m.theta - tau * (tau * s.alpha + 2.0 * (s.omega - initial_speed_)), s.omega, s.alpha};
        }
        m.theta += initial_angle_;
        return m;
    }

    // The reference a time dt after the sample at `time`, before the next one. With smoothing it is extrapolated from the sample's
    // derivatives.
    Motion after(const Motion& sampled, double time, double dt) const {
        if (config_.smoothing != 0.0) {
            return {sampled.theta + dt * (sampled.omega + 0.5 * dt * sampled.alpha), sampled.omega + dt * sampled.alpha,
                    sampled.alpha};
        }
        Motion m = at(time + dt);
        m.theta += initial_angle_;
        return m;
    }

private:
    // The reference without filter and initial angle.
    Motion at(double time) const {
        const ReferenceConfig& r = config_;
        switch (r.kind) {
            case ReferenceKind::constant:
                return {r.speed * time, r.speed, 0.0};
            case ReferenceKind::ramp:
                return ramp(time);
            case ReferenceKind::profile:
                return {profile_area(time) - area_at_start_, r.profile.held(time), r.profile.held_slope(time)};
            case ReferenceKind::sine: {
                const double omega = turns_per_second(r.frequency), angle = 2.0 * std::numbers::pi * r.frequency * time;
                return {r.offset * time + integral_of_sine({r.amplitude, r.frequency, 0.0}, time),
                        r.offset + r.amplitude * sine(angle), r.amplitude * omega * cosine(angle)};
            }
            case ReferenceKind::fm: {
                const double omega = turns_per_second(r.frequency), m = turns_per_second(r.modulation);
                const double angle = omega * time + r.depth * sine(m * time);
                return {r.offset * time + r.amplitude * fm_.at(time), r.offset + r.amplitude * sine(angle),
                        r.amplitude * cosine(angle) * (omega + r.depth * m * cosine(m * time))};
            }
            case ReferenceKind::sines: {
                Motion sum{r.offset * time, r.offset, 0.0};
                for (const Sine& s : r.sines) {
                    const double omega = turns_per_second(s.frequency), angle = omega * time + s.phase;
                    sum.theta += integral_of_sine(s, time);
                    sum.omega += s.amplitude * sine(angle);
                    sum.alpha += s.amplitude * omega * cosine(angle);
                }
                return sum;
            }
            case ReferenceKind::moves: {
                Motion m = move(time);
                m.theta -= angle_at_start_;
                return m;
            }
        }
        return {};
    }

    Motion ramp(double time) const {
        const double change = config_.speed - initial_speed_;
        const double omega = initial_speed_ + std::copysign(std::min(std::abs(change), config_.ramp * time), change);
        const double slope = std::copysign(config_.ramp, change);
        if (change == 0.0 || config_.ramp * time < std::abs(change)) {
            return {(initial_speed_ + 0.5 * (omega - initial_speed_)) * time, omega, change == 0.0 ? 0.0 : slope};
        }
        const double end = std::abs(change) / config_.ramp;
        return {0.5 * (initial_speed_ + config_.speed) * end + config_.speed * (time - end), omega, 0.0};
    }

    // The integral of the profile from its first point on.
    double profile_area(double time) const {
        const Table& p = config_.profile;
        if (time <= p.at.front()) return p.value.front() * (time - p.at.front());
        const std::size_t from = p.place(time);
        return area_[from] + 0.5 * (p.value[from] + p.held(time)) * (time - p.at[from]);
    }

    // A quintic polynomial from rest to rest between two points; before the first point and after the last the angle is held.
    Motion move(double time) const {
        const Table& p = config_.moves;
        if (time <= p.at.front()) return {p.value.front(), 0.0, 0.0};
        const std::size_t from = p.place(time);
        if (from + 1 == p.at.size()) return {p.value.back(), 0.0, 0.0};
        const double change = p.value[from + 1] - p.value[from], rate = 1.0 / (p.at[from + 1] - p.at[from]);
        const double s = (time - p.at[from]) * rate;
        return {p.value[from] + change * s * s * s * (10.0 + s * (-15.0 + 6.0 * s)),
                change * rate * 30.0 * s * s * (1.0 + s * (-2.0 + s)),
                change * rate * rate * 60.0 * s * (1.0 + s * (-3.0 + 2.0 * s))};
    }

    // Coefficients for one sample of the filter: its exact response to the parabola through the speeds at the sample's
    // start, middle and end.
    void set_filter() {
        const double tau = config_.smoothing, h = period_ / tau;  // time in units of tau from here on
        if (!(tau > 0.0 && h <= 10.0)) {
            throw std::invalid_argument("reference.smoothing: expected 0, or a tenth of the law's period or more");
        }
        const double decay = exponential(-h);
        to_omega_ = {decay * (1.0 + h), decay * h * tau, 0.0, 0.0, 0.0};
        to_alpha_ = {-decay * h / tau, decay * (1.0 - h), 0.0, 0.0, 0.0};
        constexpr int panels = 400;
        for (int n = 0; n < panels; ++n) {
            for (int k = -1; k <= 1; ++k) {  // Gauss's rule of three points
                const double x = (n + 0.5 + 0.5 * k * std::sqrt(0.6)) / panels, weight = (k == 0 ? 8.0 : 5.0) / 18.0 / panels;
                const double left = h * (1.0 - x), impulse = exponential(-left);
                const std::array<double, 3> parabola{(1.0 - 2.0 * x) * (1.0 - x), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)};
                for (std::size_t p = 0; p < 3; ++p) {
                    to_omega_[2 + p] += weight * h * parabola[p] * left * impulse;
                    to_alpha_[2 + p] += weight * h * parabola[p] * (1.0 - left) * impulse / tau;
                }
            }
        }
    }

    ReferenceConfig config_;
    double initial_angle_, initial_speed_, period_;
    IntegralOfFm fm_;
    std::vector<double> area_;  // rad, the integral of the profile up to each of its points
    double area_at_start_ = 0.0, angle_at_start_ = 0.0;
    // one sample of the filter, as weights of omega, alpha and the input speed at start, middle and end of the sample
    std::array<double, 5> to_omega_{}, to_alpha_{};
};

}  // namespace cogless
