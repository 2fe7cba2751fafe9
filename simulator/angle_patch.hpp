// What depends on the rotor's angle, as Taylor polynomials about a nearby angle. They serve the many evaluations within a period of
// the inverter: without them each would compute a sine, a cosine and their powers.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "angle_functions.hpp"
#include "wide.hpp"

namespace cogless {

class AnglePatch {
public:
    static constexpr bool share_angles = false;
    static constexpr bool brief = false;

    explicit AnglePatch(const AngleFunctions<double>& of) : of_(of), reach_(furthest / of.highest_order()) {}

    // Develops the polynomials about the angle `ahead` (rad) beyond theta_m, or about a closer one, so that theta_m stays in reach.
    [[gnu::noinline]] void move_to(double theta_m, double ahead) {
        centre_ = theta_m + std::copysign(std::min(0.9 * reach_, std::abs(ahead)), ahead);
        of_.taylor_at(centre_, [this](std::size_t k, const std::array<double, 5>& terms) __attribute__((always_inline)) {
            for (std::size_t n = 0; n < terms.size(); ++n) c_[n].set(k, terms[n]);
        });
    }

    // What depends on the angle, at theta_m. If theta_m is out of reach, the polynomials move first.
    [[gnu::always_inline]] AtAngle<double> operator()(double theta_m) {
        double x = theta_m - centre_;
        if (!(std::abs(x) <= reach_)) {
            move_to(theta_m, x);
            x = theta_m - centre_;
        }
        const Six all = six_of(x), square = six_of(x * x);
        const Six sum = (c_[0] + c_[1] * all) + (c_[2] + (c_[3] + c_[4] * all) * all) * square;
        return {{sum[0], sum[1]}, {sum[2], sum[3]}, sum[4], sum[5]};
    }

    // What depends on an angle, computed when it is converted.
    struct Later {
        AnglePatch& patch;
        double theta_m;

        [[gnu::always_inline]] operator AtAngle<double>() const { return patch(theta_m); }
    };
    // What depends on each of two angles. A step uses the second one last; computed there, it needs no registers until then.
    [[gnu::always_inline]] std::pair<AtAngle<double>, Later> both(double a, double b) { return {(*this)(a), {*this, b}}; }

    // A patch's functions for a brief step (equations.hpp).
    struct Brief {
        static constexpr bool share_angles = false, brief = true;
        AnglePatch& patch;

        [[gnu::always_inline]] AtAngle<double> operator()(double theta_m) { return patch(theta_m); }
        [[gnu::always_inline]] auto both(double a, double b) { return patch.both(a, b); }
    };

private:
    using Six = Wide<2, 3>;  // the six numbers of AtAngle
    // Six times x. A difference from zero costs nothing, while Wide's sum with zero is computed, since it changes the sign of -0.0.
    [[gnu::always_inline]] static Six six_of(double x) {
        Six all;
        for (Six::Register& part : all.part) part = x - Six::Register{};
        return all;
    }
    // Largest x = order times distance from the centre, rad. The remainder of a sinusoid of that order is at most x^5 / 5!: less
    // than 1e-7 of the amplitude.
    static constexpr double furthest = 0.1;

    const AngleFunctions<double>& of_;
    double reach_, centre_ = 0.0;
    std::array<Six, 5> c_{};
};

}  // namespace cogless
