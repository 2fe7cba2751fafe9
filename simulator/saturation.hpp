// A motor's flux linkages as functions of its currents, instead of constant inductances.
//
// Linkages and torque follow from one coenergy, W' = integral of d(i_d) + integral of q(i_q) + i_d cross(i_q), so energy is
// conserved. cross(i_q) is the change of lambda_d by i_q, which takes it from the magnets' flux. By the coenergy lambda_q then has
// a part i_d cross'(i_q).
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <stdexcept>
#include <vector>

namespace cogless {

// A function with given values and slopes at points: cubic between two points, straight beyond the ends.
class Curve {
public:
    struct At {
        double value, slope, curvature;
    };

    // Throws std::invalid_argument unless there are two or more points in rising order, each with a value and a slope.
    Curve(const std::vector<double>& at, const std::vector<double>& value, const std::vector<double>& slope) {
        const std::size_t n = at.size();
        if (n < 2 || value.size() != n || slope.size() != n) throw std::invalid_argument("saturation: expected points");
        add(at[0], {value[0], slope[0], 0.0, 0.0});
        for (std::size_t k = 0; k + 1 < n; ++k) {
            const double h = at[k + 1] - at[k], mean = (value[k + 1] - value[k]) / h;
            if (!(h > 0.0)) throw std::invalid_argument("saturation: expected rising points");
            add(at[k], {value[k], slope[k], (3.0 * mean - 2.0 * slope[k] - slope[k + 1]) / h,
                        (slope[k] + slope[k + 1] - 2.0 * mean) / (h * h)});
        }
        add(at[n - 1], {value[n - 1], slope[n - 1], 0.0, 0.0});
        offset_ = 0.0;
        offset_ = integral(0.0);
    }

    At at(double x) const {
        const Piece& p = piece(x);
        const double s = x - p.from;
        const auto& c = p.c;
        return {c[0] + s * (c[1] + s * (c[2] + s * c[3])), c[1] + s * (2.0 * c[2] + 3.0 * s * c[3]),
                2.0 * c[2] + 6.0 * s * c[3]};
    }

    // The integral from zero.
    double integral(double x) const {
        const Piece& p = piece(x);
        return p.before + primitive(p.c, x - p.from) - offset_;
    }

private:
    using Cubic = std::array<double, 4>;
    struct Piece {
        double from;    // x at the piece's start; the first and the second piece have one `from`
        Cubic c;        // coefficients of the powers of x - from
        double before;  // integral up to `from`
    };

    static double primitive(const Cubic& c, double s) {
        return s * (c[0] + s * (c[1] / 2.0 + s * (c[2] / 3.0 + s * c[3] / 4.0)));
    }

    void add(double from, const Cubic& c) {
        const double before = pieces_.empty() ? 0.0 : pieces_.back().before + primitive(pieces_.back().c, from - pieces_.back().from);
        pieces_.push_back({from, c, before});
    }

    const Piece& piece(double x) const {
        const auto above = std::upper_bound(pieces_.begin() + 1, pieces_.end(), x, [](double v, const Piece& p) { return v < p.from; });
        return *(above - 1);
    }

    std::vector<Piece> pieces_;
    double offset_ = 0.0;
};

struct Saturation {
    Curve d, q, cross;  // V s over A, each zero at zero

    struct Flux {
        double d, q;                // V s, linkages due to the currents
        double l_dd, l_qq, l_dq;    // H, differential inductances
    };

    Flux flux(double i_d, double i_q) const {
        const Curve::At of_d = d.at(i_d), of_q = q.at(i_q), both = cross.at(i_q);
        return {of_d.value + both.value, of_q.value + i_d * both.slope, of_d.slope, of_q.slope + i_d * both.curvature,
                both.slope};
    }

    // Energy of the currents' field over the power factor, J: i . lambda less the coenergy.
    double energy(double i_d, double i_q) const {
        return i_d * d.at(i_d).value - d.integral(i_d) + i_q * q.at(i_q).value - q.integral(i_q) +
               i_d * i_q * cross.at(i_q).slope;
    }
};

}  // namespace cogless
