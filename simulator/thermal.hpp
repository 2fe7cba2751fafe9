// Temperatures of a motor's winding and magnets, which change resistance and flux. Both bodies have a heat capacity. Copper loss
// heats the winding; the bodies exchange heat with each other and with the ambient.
#pragma once

namespace cogless {

struct Temperatures {
    double winding, magnet;  // degC
};

// Factors on the motor's resistance and flux at the reference temperature.
struct Warmth {
    double resistance, flux;
};

struct ThermalConfig {
    double reference;               // degC, at which the motor's resistance and flux are as described
    double resistance_coefficient;  // 1/K, of the winding
    double flux_coefficient;        // 1/K, of the magnets
    Temperatures start;
    bool drifts;                    // false: the temperatures stay at `start`
    double ambient;                                              // degC
    double winding_capacity, magnet_capacity;                    // J/K
    double winding_to_ambient, winding_to_magnet, magnet_to_ambient;  // W/K

    Warmth warmth(Temperatures at) const {
        return {1.0 + resistance_coefficient * (at.winding - reference), 1.0 + flux_coefficient * (at.magnet - reference)};
    }

    // The temperatures h later, by RK4. cold_loss, cold_loss_after: copper loss at begin and end with the resistance at the reference
    // temperature, W; linear in between.
    Temperatures after(Temperatures now, double cold_loss, double cold_loss_after, double h) const {
        const Temperatures k1 = slope(now, cold_loss);
        const double middle = 0.5 * (cold_loss + cold_loss_after);
        const Temperatures k2 = slope(along(now, k1, 0.5 * h), middle), k3 = slope(along(now, k2, 0.5 * h), middle);
        const Temperatures k4 = slope(along(now, k3, h), cold_loss_after);
        return {now.winding + h / 6.0 * (k1.winding + 2.0 * (k2.winding + k3.winding) + k4.winding),
                now.magnet + h / 6.0 * (k1.magnet + 2.0 * (k2.magnet + k3.magnet) + k4.magnet)};
    }

private:
    static Temperatures along(Temperatures x, Temperatures slope, double h) {
        return {x.winding + h * slope.winding, x.magnet + h * slope.magnet};
    }

    Temperatures slope(Temperatures at, double cold_loss) const {
        const double between = winding_to_magnet * (at.winding - at.magnet);
        const double heat = cold_loss * warmth(at).resistance;
        return {(heat - winding_to_ambient * (at.winding - ambient) - between) / winding_capacity,
                (between - magnet_to_ambient * (at.magnet - ambient)) / magnet_capacity};
    }
};

}  // namespace cogless
