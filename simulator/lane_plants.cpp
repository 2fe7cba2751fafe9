#include "lane_plants.hpp"

#include "lane_step.hpp"

namespace cogless {

namespace {

template <class Real>
class Plants : public LanePlants {
public:
    Plants(const std::vector<const Plant*>& plants, Detail detail, std::size_t legs)
        : equations_(equations_of(plants)), detail_(detail), legs_(legs) {}

    static std::unique_ptr<LanePlants> make(const std::vector<const Plant*>& plants, Detail detail, std::size_t legs) {
        return std::make_unique<Plants>(plants, detail, legs);
    }

    View view() override {
        PlantState<Real>& x = s_.x;
        LaneInverter<Real>& v = inverter_;
        return {first(x.theta_m), first(x.omega_m), first(x.i.d), first(x.i.q), first(x.load.torque), first(x.load.target),
                {first(v.current[0]), first(v.current[1]), first(v.current[2])},
                {first(sensors_.measured[0]), first(sensors_.measured[1]), first(sensors_.measured[2])},
                {first(v.duty[0]), first(v.duty[1]), first(v.duty[2])},
                {first(v.last[0]), first(v.last[1]), first(v.last[2])},
                first(v.bus_voltage), first(v.dead_share), first(v.device_drop), first(u_.alpha), first(u_.beta)};
    }

    void put(std::size_t lane, const PlantState<>& x, const AtAngle<double>& here) override {
        each(x, here, [lane](Real& to, double from) { to.set(lane, from); });
        s_.x.stuck.set(lane, x.stuck);
    }

    void get(std::size_t lane, PlantState<>& x, AtAngle<double>& here) const override {
        const_cast<Plants*>(this)->each(x, here, [lane](Real& from, double& to) { to = from[lane]; });
        x.stuck = s_.x.stuck[lane];
    }

    void put(std::size_t lane, const CurrentSensors& sensors, const Random& random) override {
        const CurrentSensorsConfig& config = sensors.config();
        for (std::size_t n = 0; n < 3; ++n) {
            sensors_.offset[n].set(lane, config.offset[n]);
            sensors_.gain_error[n].set(lane, config.gain_error[n]);
        }
        sensors_.noise.set(lane, config.noise);
        sensors_.step.set(lane, sensors.step());
        sensors_.per_step.set(lane, 1.0 / sensors.step());
        sensors_.highest.set(lane, sensors.highest());
        sensors_.lowest.set(lane, -config.range);
        sensors_.converts.set(lane, config.bits > 0 ? 1.0 : 0.0);
        sensors_.two.set(lane, config.sensors == 2 ? 1.0 : 0.0);
        sensors_.random[lane] = random.state();
        sensors_.noisy |= config.noise > 0.0;
        sensors_.edges = CurrentSensors::normal().edges();
    }

    void get(std::size_t lane, Random& random) const override { random = Random(sensors_.random[lane]); }

    void measure() override { lane_currents(s_, inverter_, sensors_, legs_); }
    void apply(const Carrier& carrier) override { lane_voltage(inverter_, u_, carrier, legs_); }

    std::uint32_t step(double h) override { return lane_step(equations_, s_, u_, h, detail_); }

private:
    static Each<Equations<double>, Real> equations_of(const std::vector<const Plant*>& plants) {
        Each<Equations<double>, Real> all;
        for (std::size_t lane = 0; lane < all.size(); ++lane) {
            all[lane] = &plants[lane < plants.size() ? lane : 0]->equations();
        }
        return all;
    }

    static double* first(Real& x) { return reinterpret_cast<double*>(&x); }

    // Calls f(a, b) for each number of a state: a is the number in all lanes, b its counterpart in x or `here`.
    template <class State, class Here, class F>
    void each(State& x, Here& here, const F& f) {
        f(s_.x.i.d, x.i.d);
        f(s_.x.i.q, x.i.q);
        f(s_.x.omega_m, x.omega_m);
        f(s_.x.theta_m, x.theta_m);
        f(s_.x.load.torque, x.load.torque);
        f(s_.x.load.target, x.load.target);
        f(s_.x.direction, x.direction);
        f(s_.x.energy.electrical, x.energy.electrical);
        f(s_.x.energy.copper, x.energy.copper);
        f(s_.x.energy.friction, x.energy.friction);
        f(s_.x.energy.load, x.energy.load);
        f(s_.here.axis.re, here.axis.re);
        f(s_.here.axis.im, here.axis.im);
        f(s_.here.ripple.d, here.ripple.d);
        f(s_.here.ripple.q, here.ripple.q);
        f(s_.here.cogging, here.cogging);
        f(s_.here.load, here.load);
    }

    Equations<Real> equations_;
    Detail detail_;
    std::size_t legs_;
    LaneStates<Real> s_{};
    LaneInverter<Real> inverter_{};
    LaneSensors<Real> sensors_{};
    Voltage<Real> u_{};
};

}  // namespace

double draw_at_edge(std::uint64_t& state, std::size_t layer, double x) {
    Random random(state);
    const double draw = CurrentSensors::normal().at_edge(random, {layer, x});
    state = random.state();
    return draw;
}

template <class Real>
static LaneKernel kernel(const char* name) {
    return {name, Real::lanes, &Plants<Real>::make, &step_loops<Real>, &step_quietly<Real>, &watch<Real>,
            &sum_orders<Real>};
}

std::vector<LaneKernel> lane_kernels() {
    std::vector<LaneKernel> all;
#if defined(COGLESS_X86_LANES)
    if (__builtin_cpu_supports("avx512f")) all.push_back(kernel<Avx512>("avx512"));
    if (__builtin_cpu_supports("avx2")) all.push_back(kernel<Avx2>("avx2"));
#endif
    all.push_back(kernel<Sse2>("128 bits"));
    return all;
}

}  // namespace cogless
