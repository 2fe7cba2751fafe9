// The part of Drive that advances several drives in step, each in a lane. drive.cpp includes this file, since it needs the templates there;
// FMUs and live pages run each drive alone, and leave it out.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "cogless/angle.h"
#include "cogless/drive_parts.h"
#include "cogless/sine.h"
#include "drive.hpp"
#include "lane_plants.hpp"

namespace cogless {

bool Drive::alike(const Drive& other) const {
    const auto fits = [](const Drive& d) {
        return !d.config_.trials && !(d.config_.inverter.switched && !d.config_.ideal_current) &&
               !std::holds_alternative<CallbackLaw>(d.config_.law) && !d.phases_.front().cold;
    };
    const DriveConfig &a = config_, &b = other.config_;
    return fits(*this) && fits(other) && a.ideal_current == b.ideal_current && motor_phases(a) == motor_phases(b) &&
           a.inverter.pwm == b.inverter.pwm && a.current_rate == b.current_rate && a.integration_steps == b.integration_steps && a.energy == b.energy &&
           phases_.front().plant.equations().alike(other.phases_.front().plant.equations());
}

void Drive::advance_lanes(std::vector<Lane>& lanes, const LaneKernel& kernel, std::int64_t ticks) {
    const Drive& first = *lanes.front().drive;
    std::vector<const Plant*> of;
    for (Lane& lane : lanes) {
        if (!lane.drive->alike(first) || lane.state->tick != lanes.front().state->tick || lanes.size() > kernel.lanes) {
            throw std::invalid_argument("lanes: expected drives that are alike and at the same tick, at most " +
                                        std::to_string(kernel.lanes));
        }
        of.push_back(&lane.drive->phases_.front().plant);
        lane.recorder->reserve(lane.state->tick, ticks);
    }
    const std::int64_t end = lanes.front().state->tick + ticks;
    first.specialised([&]<std::size_t legs, Detail detail> { run_lanes<legs, detail>(lanes, kernel, *kernel.make(of, detail, legs), end); });
}

bool Drive::joins(const Drive& other) const {
    const auto fits = [](const Drive& d) {
        const DriveConfig& c = d.config_;
        return !c.ideal_current && !c.bus && !c.current_reference && !c.dead_time && !d.steps_currents_ && c.inverter.pwm != Pwm::edge;
    };
    const cgl_drive_config &a = config_.control, &b = other.config_.control;
    return fits(*this) && fits(other) && a.foc.decoupling == b.foc.decoupling && a.monitor.phases == b.monitor.phases;
}

bool Drive::rests() const {
    return position_sensor_.rests_between_edges() && config_.faults.empty() && !config_.sensor_on_load && !config_.encoder_table &&
           !config_.speed_filter;
}

void Drive::join(LaneLoops& loops, std::size_t lane, DriveState& s) const {
    const cgl_foc& foc = s.control.foc;
    const cgl_monitor& monitor = s.control.monitor;
    loops.two_phases = foc.config.phases == 2U;
    loops.decoupling = foc.config.decoupling;
    loops.monitor_phases = monitor.config.phases;
    loops.kp_d[lane] = foc.config.kp_d;
    loops.kp_q[lane] = foc.config.kp_q;
    loops.rise_d[lane] = foc.rise_d;
    loops.rise_q[lane] = foc.rise_q;
    loops.L_d[lane] = foc.config.L_d;
    loops.L_q[lane] = foc.config.L_q;
    loops.psi_f[lane] = foc.config.psi_f;
    loops.current_limit[lane] = foc.config.current_limit;
    loops.travel_square[lane] = monitor.limits.travel_square;
    loops.speed_square[lane] = monitor.limits.speed_square;
    loops.doubt_square[lane] = monitor.limits.doubt_square;
    loops.current_square[lane] = monitor.limits.current_square;
    loops.sum_square[lane] = monitor.limits.sum_square;
    loops.period[lane] = monitor.ts;
    loops.pole_pairs[lane] = s.control.pole_pairs;
    loops.u_dc[lane] = static_cast<cgl_real>(config_.inverter.bus_voltage);
    loops.delayed[lane] = config_.inverter.computation_delay ? CGL_R(1.0) : CGL_R(0.0);
    loops.least_duty[lane] = least_duty_;
    static_assert(offsetof(cgl_foc_input, i_q_ref) == 7 * sizeof(cgl_real));
    loops.in[lane] = s.control.currents.i_abc;
    put(loops, lane, s);
}

void Drive::put(LaneLoops& loops, std::size_t lane, const DriveState& s) const {
    loops.integral_d[lane] = s.control.foc.integral_d;
    loops.integral_q[lane] = s.control.foc.integral_q;
    loops.lost_d[lane] = s.control.foc.lost_d;
    loops.lost_q[lane] = s.control.foc.lost_q;
    std::tie(loops.theta_low[lane], loops.theta_high[lane]) = position_sensor_.bounds(s.position);
    loops.theta_before[lane] = s.position.theta_before;
    for (std::size_t k = 0; k < s.duty.size(); ++k) loops.computed[k][lane] = static_cast<cgl_real>(s.duty[k]);
}

void Drive::get(const LaneLoops& loops, std::size_t lane, DriveState& s) {
    s.control.foc.integral_d = loops.integral_d[lane];
    s.control.foc.integral_q = loops.integral_q[lane];
    s.control.foc.lost_d = loops.lost_d[lane];
    s.control.foc.lost_q = loops.lost_q[lane];
    for (std::size_t k = 0; k < s.duty.size(); ++k) s.duty[k] = static_cast<double>(loops.computed[k][lane]);
}

void Drive::turn(LaneLoops& loops, std::size_t lane, const cgl_foc& foc, cgl_real theta_e, cgl_real omega_e) {
    const cgl_real ahead = foc.ahead * omega_e;
    cgl_phasor rotor{std::numeric_limits<cgl_real>::quiet_NaN(), CGL_R(0.0)}, acting = rotor;
    if (cgl_is_angle(theta_e) && cgl_is_angle(theta_e + ahead)) {
        cgl_sincos_of_angle(theta_e, &rotor.sine, &rotor.cosine);
        acting = cgl_product(rotor, cgl_phasor_ahead(ahead));
    }
    loops.sine[lane] = rotor.sine;
    loops.cosine[lane] = rotor.cosine;
    loops.acting_sine[lane] = acting.sine;
    loops.acting_cosine[lane] = acting.cosine;
}

void Drive::sum_orders(const LaneKernel& kernel, LaneOrders& all, OrderSums& of, std::uint32_t lanes) {
    const auto ranges = [&of](std::size_t n) {
        const cgl_orders& o = of[n].orders;
        return std::array{o.begin, o.end, o.low, o.acting};
    };
    const auto first = ranges(static_cast<std::size_t>(std::countr_zero(lanes)));
    std::uint32_t together = 0;
    for (std::size_t n = 0; n < kernel.lanes; ++n) {
        if ((lanes >> n & 1U) != 0U && ranges(n) == first) together |= 1U << n;
    }
    // with fewer than half of the lanes, one by one is faster
    if (2 * static_cast<std::size_t>(std::popcount(together)) < kernel.lanes) together = 0;
    if (together != 0U) {
        all.begin = first[0], all.end = first[1], all.low = first[2], all.acting = first[3];
        for (std::size_t n = 0; n < kernel.lanes; ++n) {
            const cgl_orders& o = of[n].orders;
            const bool sums = (together >> n & 1U) != 0U;
            all.cosine[n] = sums ? o.cosine : all.unused;
            all.sine[n] = sums ? o.sine : all.unused;
            all.gain[n] = sums ? o.gain : all.unused;
            all.first_cosine[n] = o.first.cosine;
            all.first_sine[n] = o.first.sine;
            all.loads[n] = o.loads;
            all.error[n] = o.error;
            all.limit[n] = o.limit;
            all.phase_sum[n] = o.phase_sum;
        }
        kernel.sum_orders(all);
    }
    for (std::size_t n = 0; n < kernel.lanes; ++n) {
        if ((together >> n & 1U) != 0U) {
            of[n].sum = all.sum[n];
            of[n].orders.phase_sum = all.phase_sum[n];
        } else if ((lanes >> n & 1U) != 0U) {
            of[n].sum = cgl_sum_of_orders(&of[n].orders);
        }
    }
}

void Drive::take_output(const LaneLoops& loops, std::size_t lane, DriveState& s) {
    const auto& all = loops.output;
    s.output = {{all[0][lane], all[1][lane], all[2][lane]}, all[3][lane], all[4][lane], all[5][lane], all[6][lane], all[7][lane],
                all[8][lane], 0U};
    cgl_drive_conclude(&s.control, &s.output, cgl_drive_status(&s.control));
}

struct Drive::Running {
    std::size_t n;  // its lane
    bool joins;     // it is in the LaneLoops
    bool rests;     // it can have quiet periods
    Lane* lane;
    const Drive* drive;
    const Phase* phase;
    DriveState* state;
    Every law, row;
    Faults faults;
    Phases current{};
    Acting acting{};
    std::int64_t wakes = 0;  // tick at which its quiet periods end
};

void Drive::show_angle(LaneLoops& loops, const Running& r) {
    const DriveState& s = *r.state;
    const cgl_real pole_pairs = s.control.pole_pairs, last = loops.theta_m[r.n];
    loops.theta_m[r.n] = static_cast<cgl_real>(r.drive->position_sensor_.angle(s.position));
    if (loops.theta_m[r.n] != last) turn(loops, r.n, s.control.foc, pole_pairs * loops.theta_m[r.n], pole_pairs * loops.omega_m[r.n]);
}

bool Drive::sleep(LaneLoops& loops, Running& r) {
    DriveState& s = *r.state;
    if (!r.rests || r.acting.open || !s.control.monitor.trusted) return false;
    const std::vector<LoadStep>& steps = r.phase->config.load_steps;
    r.wakes = s.tick + std::min({r.law.wait(), r.row.wait(), static_cast<std::int64_t>(s.control.countdown)});
    if (s.next_load_step < steps.size()) r.wakes = std::min(r.wakes, steps[s.next_load_step].tick);
    if (r.wakes <= s.tick) return false;
    const std::size_t n = r.n;
    // the monitor trusts this period, so its angle and speed are those that the sensor shows
    loops.theta_m[n] = s.control.monitor.theta_m;
    loops.omega_m[n] = s.control.monitor.omega_m;
    show_angle(loops, r);
    loops.omega_ref[n] = cgl_drive_omega_ref(&s.control, &s.asked);
    loops.i_d_ref[n] = s.control.currents.i_d_ref;
    loops.i_q_ref[n] = s.control.command.i_q_ref;
    loops.theta_sensor[n] = s.control.monitor.theta_sensor;
    loops.ref_turned[n] = s.control.monitor.ref_turned;
    return true;
}

void Drive::wake(const LaneLoops& loops, Running& r, std::int64_t tick) {
    DriveState& s = *r.state;
    const std::int64_t quiet = tick - s.tick;
    if (quiet == 0) return;
    cgl_monitor& monitor = s.control.monitor;
    monitor.theta_m = monitor.theta_sensor = loops.theta_sensor[r.n];
    monitor.ref_turned = loops.ref_turned[r.n];
    s.control.countdown -= static_cast<std::uint32_t>(quiet);
    take_output(loops, r.n, s);
    r.law.skip(quiet);
    r.row.skip(quiet);
    s.tick = tick;
}

bool Drive::begin_law(DriveState& s, OrderSum& orders) const {
    const auto* law = std::get_if<CLaw<harmonic_row>>(&config_.law);
    return law != nullptr && law->begin(state_of(s.law, *law), s.control.in, orders);
}

template <std::size_t legs>
void Drive::end_law(DriveState& s, const OrderSum& orders) const {
    const auto& law = std::get<CLaw<harmonic_row>>(config_.law);
    obey<legs>(s, law.end(state_of(s.law, law), s.control.in, orders));
}

// As run(), but the steps of plants, those of current loops, and sums of orders are each computed together. These are computed alone: a
// plant whose rotor stops or breaks away, or whose bridge is open, and a current loop at a limit.
template <std::size_t legs, Detail detail>
void Drive::run_lanes(std::vector<Lane>& lanes, const LaneKernel& kernel, LanePlants& plants, std::int64_t end) {
    const Drive& first = *lanes.front().drive;
    const double h = first.step_;
    const LanePlants::View view = plants.view();
    AtAngle<double> here;
    LaneLoops loops;
    LaneOrders all_orders;
    OrderSums orders{};
    const cgl_foc_input nothing{};
    std::fill(std::begin(loops.in.of), std::end(loops.in.of), nothing.i_abc);
    loops.states[0] = view.theta_m;
    loops.states[1] = view.omega_m;
    loops.states[2] = view.i_d;
    loops.states[3] = view.i_q;
    for (std::size_t k = 0; k < view.duty.size(); ++k) {
        loops.measured[k] = view.measured[k];
        loops.duty[k] = view.duty[k];
    }
    // Lanes as bits: those that still run, those whose edges the kernel watches, those whose edges are watched one by one, and those in
    // quiet periods.
    std::uint32_t alive = 0, watched = 0, watching = 0, asleep = 0;
    const auto has = [](std::uint32_t set, const Running& r) { return (set >> r.n & 1U) != 0U; };
    std::vector<Running> all;
    for (std::size_t n = 0; n < lanes.size(); ++n) {
        const auto& [drive, s, recorder, error] = lanes[n];
        const Phase& phase = drive->phases_.front();
        const bool joins = drive->joins(first), rests = joins && drive->rests();
        if (joins) {
            drive->join(loops, n, *s);
            plants.put(n, drive->current_sensors_, s->random);
        }
        alive |= 1U << n;
        if (rests) {
            watched |= 1U << n;
        } else if (drive->position_sensor_.watches()) {
            watching |= 1U << n;
        }
        all.push_back({n, joins, rests, &lanes[n], drive, &phase, s, {drive->config_.speed_divider, s->tick}, recorder->rows(s->tick),
                       drive->faults_at(s->tick)});
        plants.put(n, s->plant, Plant::Exact<detail>(phase.plant)(s->plant.theta_m));
        view.dead_share[n] = drive->dead_share_;
        view.device_drop[n] = drive->config_.inverter.device_drop;
        for (std::size_t k = 0; k < s->applied.size(); ++k) view.last[k][n] = s->applied[k];
    }
    const auto leave = [&](Running& r, std::int64_t tick) {
        if (has(asleep, r)) wake(loops, r, tick);
        plants.get(r.n, r.state->plant, here);
        if (!r.joins) return;
        get(loops, r.n, *r.state);
        plants.get(r.n, r.state->random);
        if (r.rests) r.state->position.theta_before = loops.theta_before[r.n];
    };
    const Pwm pwm = first.config_.inverter.pwm;
    std::int64_t wakes = 0;  // first tick at which a lane's quiet periods end
    for (std::int64_t tick = lanes.front().state->tick; tick < end; ++tick) {
        if constexpr (legs != 0) plants.measure();
        if (asleep != 0U) {
            std::uint32_t goes_on = asleep;
            if (tick >= wakes) {
                for (const Running& r : all) {
                    if (r.wakes <= tick) goes_on &= ~(1U << r.n);
                }
            }
            if (goes_on != 0U) goes_on = kernel.step_quietly(loops, goes_on);
            if (goes_on != asleep) {
                for (Running& r : all) {
                    if (has(asleep & ~goes_on, r)) wake(loops, r, tick);
                }
            }
            asleep = goes_on;
        }
        std::uint32_t summing = 0;  // awake lanes whose law needs a sum of orders
        std::uint32_t stepped = 0;  // awake lanes whose current loops step together
        if (asleep != alive) {
            for (Running& r : all) {
                if (has(asleep, r)) continue;
                const std::size_t n = r.n;
                const Drive& drive = *r.drive;
                const Phase& phase = *r.phase;
                DriveState& s = *r.state;
                s.plant.theta_m = view.theta_m[n];
                s.plant.omega_m = view.omega_m[n];
                s.plant.i = {view.i_d[n], view.i_q[n]};
                step_load(s, phase, 0, view.load_torque[n], view.load_target[n]);
                if constexpr (legs != 0) r.current = {view.current[0][n], view.current[1][n], view.current[2][n]};
                if (tick >= r.faults.until) r.faults = drive.faults_at(tick);
                try {
                    if (legs != 0 && r.joins) {
                        const Phases measured{view.measured[0][n], view.measured[1][n], view.measured[2][n]};
                        const bool due = drive.control<legs, legs == 0>(s, phase, 0, r.law.next(), measured, r.faults, nullptr, &orders[n]);
                        summing |= std::uint32_t{due} << n;
                    } else {
                        drive.control<legs>(s, phase, 0, r.law.next(), r.current, r.faults, nullptr);
                    }
                } catch (const std::runtime_error& error) {
                    leave(r, tick);
                    alive &= ~(1U << n);
                    r.lane->error = error.what();
                }
            }
            if (summing != 0U) sum_orders(kernel, all_orders, orders, summing);
            watched &= alive;
            watching &= alive;
            std::erase_if(all, [](const Running& r) { return !r.lane->error.empty(); });
            for (const Running& r : all) {
                if (has(asleep, r) || !r.joins) continue;
                DriveState& s = *r.state;
                if (has(summing, r)) r.drive->end_law<legs>(s, orders[r.n]);
                if (!cgl_drive_controls(&s.control) || s.open) continue;
                s.control.currents.i_q_ref = s.control.command.i_q_ref;
                turn(loops, r.n, s.control.foc, s.control.currents.theta_e, s.control.currents.omega_e);
                stepped |= 1U << r.n;
            }
            if (stepped != 0U) stepped = kernel.step_loops(loops, stepped);
            for (Running& r : all) {
                if (has(asleep, r)) continue;
                const std::size_t n = r.n;
                const Drive& drive = *r.drive;
                DriveState& s = *r.state;
                const bool alone = !has(stepped, r);
                if (!alone) {
                    take_output(loops, n, s);
                } else if (r.joins) {
                    get(loops, n, s);
                    drive.actuate(s);
                }
                if constexpr (legs == 0) view.i_q[n] = s.plant.i.q;
                if (r.row.next()) {
                    plants.get(n, s.plant, here);
                    drive.record<legs>(s, here, *r.phase, 0, r.current, r.lane->recorder->next_row());
                }
                r.acting.open = false;
                if constexpr (legs != 0) view.bus_voltage[n] = r.faults.bus_voltage;
                if (legs == 0 || !alone) continue;
                drive.next_duties(s, r.acting);
                for (std::size_t k = 0; k < s.applied.size(); ++k) {
                    view.duty[k][n] = r.acting.duty[k];
                    if (pwm == Pwm::edge) view.last[k][n] = s.applied[k];
                }
                drive.remember(s, r.acting.duty);
                if (r.rests) s.position.theta_before = loops.theta_before[n];
                if (r.joins) drive.put(loops, n, s);
                if (r.acting.open) plants.get(n, s.plant, here);
            }
        }
        std::uint32_t open = 0;
        if (asleep != alive) {
            for (const Running& r : all) open |= std::uint32_t{r.acting.open} << r.n;
        }
        if constexpr (legs != 0) plants.apply(carrier(pwm, tick));
        for (int k = 0; k < first.config_.integration_steps; ++k) {
            const std::uint32_t stay = plants.step(h) & alive & ~open;
            const double from = first.time(tick) + k * h;
            if (stay != 0U) {
                for (const Running& r : all) {
                    if (!has(stay, r)) continue;
                    DriveState& s = *r.state;
                    plants.get(r.n, s.plant, here);
                    const Plant& plant = r.phase->plant;
                    const Plant::Exact<detail> exact(plant);
                    plant.step<detail>(s.plant, here, {view.u_alpha[r.n], view.u_beta[r.n]}, from, h, exact);
                    plants.put(r.n, s.plant, here);
                }
            }
            const std::uint32_t between = watched & ~open, passed = between != 0U ? between & ~kernel.watch(loops, view.theta_m, between) : 0U;
            if (const std::uint32_t each = passed | (watching & ~open); each != 0U) {
                for (const Running& r : all) {
                    if (!has(each, r)) continue;
                    DriveState& s = *r.state;
                    if (r.rests) s.position.theta_before = loops.theta_before[r.n];
                    r.drive->watch(s, from, h, view.theta_m[r.n], r.faults);
                    if (!r.rests) continue;
                    std::tie(loops.theta_low[r.n], loops.theta_high[r.n]) = r.drive->position_sensor_.bounds(s.position);
                    loops.theta_before[r.n] = s.position.theta_before;
                    if (has(asleep, r)) show_angle(loops, r);
                }
            }
        }
        if (asleep == alive) continue;
        wakes = end;
        for (Running& r : all) {
            DriveState& s = *r.state;
            if (!has(asleep, r)) {
                if (r.acting.open) {
                    const Drive& drive = *r.drive;
                    AnglePatch patch(r.phase->plant.angle());
                    here = r.phase->plant.angle().at(s.plant.theta_m);
                    drive.advance_plant<legs, detail>(s, here, patch, *r.phase, 0, r.acting, r.current, r.faults, no_rows);
                    plants.put(r.n, s.plant, here);
                    if (r.joins) drive.put(loops, r.n, s);
                }
                ++s.tick;
                if (has(stepped, r) && sleep(loops, r)) asleep |= 1U << r.n;
            }
            if (has(asleep, r)) wakes = std::min(wakes, r.wakes);
        }
    }
    for (Running& r : all) leave(r, end);
}

}  // namespace cogless
