// The monitor model's step in C++, written from docs/models.md: 32 candidates side by side in plain
// arrays, selects where the scalar step branches, one thread. Compiled and called by cpp.py.

#include <cmath>

namespace {

constexpr int LANES = 32;

struct Plant {  // benchmarks/peers/task.py, in its order
    double resistance, inductance, leakage, k_e, pole_pairs, supply, half_band, current_limit,
        speed_limit, k_position, k_speed, j_m, j_o, viscous, t_m, t_o, static_ratio, c_opposing,
        c_aiding, stiffness, damping, low, high;
};

inline double clip(double x, double low, double high) {
    x = x < low ? low : x;
    return x > high ? high : x;
}

// Sine and cosine; the library's are not inlined and would keep the loop from vectorising.
// Cody and Waite reduction to +-pi/4, Taylor polynomials to degree 15 and 14: error below 1e-14.
inline void sincos_inline(double x, double &sine, double &cosine) {
    double q = std::floor(x * 0.63661977236758134308 + 0.5);
    double r = (x - q * 1.5707963267341256) - q * 6.077100506506192e-11;
    double r2 = r * r;
    double s = 1.0 / 362880.0 +
               r2 * (-1.0 / 39916800.0 + r2 * (1.0 / 6227020800.0 - r2 / 1307674368000.0));
    s = r + r * r2 * (-1.0 / 6.0 + r2 * (1.0 / 120.0 + r2 * (-1.0 / 5040.0 + r2 * s)));
    double c = 1.0 / 40320.0 +
               r2 * (-1.0 / 3628800.0 + r2 * (1.0 / 479001600.0 - r2 / 87178291200.0));
    c = 1.0 + r2 * (-0.5 + r2 * (1.0 / 24.0 + r2 * (-1.0 / 720.0 + r2 * c)));
    double quadrant = q - 4.0 * std::floor(q * 0.25);
    bool odd = (quadrant == 1.0) | (quadrant == 3.0);
    sine = odd ? c : s;
    cosine = odd ? s : c;
    sine = quadrant >= 2.0 ? -sine : sine;
    cosine = (quadrant == 1.0) | (quadrant == 2.0) ? -cosine : cosine;
}

inline double next_speed(double w, double act, double per_inertia, double ts, double td) {
    double held = clip(act, -ts, ts);
    double moving = std::copysign(td, w);
    double friction = w == 0.0 ? held : moving;
    double after = w + per_inertia * (act - friction);
    return w * after < 0.0 ? 0.0 : after;
}

// The same for long steps: what is left of the step after a mass has stopped or broken loose.
// act, mobility and td hold until a moving mass rests, those in Rest from there on; before: the
// torque in the middle of the step before, from which it grows evenly to that at rest. until: the
// share of the step until a moving mass came to rest, 1 if it did not; rate: the acceleration at
// the end.
struct Rest {
    double act, before, mobility, ts, td;
};

inline double through_rest(double w, double act, double mobility, double td, const Rest &from,
                           double dt, double &until, double &rate) {
    bool rest = w == 0.0;
    double moving = mobility * (act - std::copysign(td, w));
    double after = w + dt * moving;
    bool turns = w * after < 0.0;
    double size = std::fabs(from.act);
    double grown = size - std::copysign(from.before, from.act * from.before);
    double whole = rest ? grown : w - after;
    double part = rest ? size - from.ts : w;
    double share = part / (whole == 0.0 ? 1.0 : whole);
    share = rest & (grown <= 0.0) ? 0.5 : share;
    double left = dt * (rest ? clip(0.5 + share, 0.5, 1.5) : 1.0 - share);
    double starting = from.mobility * (from.act - std::copysign(from.td, from.act));
    starting = size <= from.ts ? 0.0 : starting;
    until = turns ? share : 1.0;
    rate = rest | turns ? starting : moving;
    return rest | turns ? left * starting : after;
}

}  // namespace

// m: (8, count) magnitudes, a row for each; count a multiple of LANES. low_pass: b a1 a2 z1 z2.
// start: i w_m x_m w_o x_o gained i_from; gained is what w_m gains in a step with the last
// acceleration, i_from the current from which the next one goes on. costs: (count).
extern "C" void costs(const double *m, int count, const Plant *plant, const double *start,
                      const double *command, const double *load, const double *target,
                      const double *weights, const double *low_pass, int samples, double dt,
                      int substeps, double *costs) {
    const Plant c = *plant;
    const double b = low_pass[0], a1 = low_pass[1], a2 = low_pass[2];
    const double j = c.j_m + c.j_o, share = 1.0 / substeps;
    const double per_m = dt / c.j_m, per_o = dt / c.j_o, half = 0.5 * dt;
    const double mobility_m = 1.0 / c.j_m, mobility_both = 1.0 / j, g = c.k_speed / (2.0 * c.k_e);
    const double part_m = c.j_m / j, part_o = c.j_o / j;
    const double sectors = c.pole_pairs * 0.95492965855137201461;  // 3/pi
    const double half_sqrt3 = 0.86602540378443864676;
    for (int first = 0; first < count; first += LANES) {
        alignas(64) double friction[LANES], gap[LANES], h_a[LANES], h_b[LANES], h_c[LANES],
            r_ab[LANES], r_a[LANES], r_b[LANES], reach_ab[LANES], reach_a[LANES],
            reach_b[LANES], gained[LANES], i_from[LANES], zeta_cos[LANES], zeta_sin[LANES], k_w[LANES],
            i[LANES], w_m[LANES], x_m[LANES], w_o[LANES], x_o[LANES], charge[LANES], z1[LANES],
            z2[LANES], cost[LANES];
        for (int n = 0; n < LANES; n++) {
            const double *own = m + first + n;
            friction[n] = own[0];
            gap[n] = own[1 * count];
            h_a[n] = own[2 * count];
            h_b[n] = own[3 * count];
            h_c[n] = own[4 * count];
            double l_a = (h_a[n] * h_a[n] * (1.0 - c.leakage) + c.leakage) * c.inductance;
            double l_b = (h_b[n] * h_b[n] * (1.0 - c.leakage) + c.leakage) * c.inductance;
            double l_c = (h_c[n] * h_c[n] * (1.0 - c.leakage) + c.leakage) * c.inductance;
            r_ab[n] = (h_a[n] + h_b[n]) * c.resistance;
            r_a[n] = (h_c[n] - h_a[n]) * c.resistance;  // by how much it differs without a
            r_b[n] = (h_c[n] - h_b[n]) * c.resistance;
            reach_ab[n] = dt / (l_a + l_b);  // a division less in each step
            reach_a[n] = dt / (l_b + l_c) - reach_ab[n];
            reach_b[n] = dt / (l_a + l_c) - reach_ab[n];
            h_a[n] *= c.k_e;
            h_b[n] *= c.k_e;
            h_c[n] *= c.k_e;
            zeta_cos[n] = own[5 * count] * std::cos(own[6 * count]);
            zeta_sin[n] = own[5 * count] * std::sin(own[6 * count]);
            k_w[n] = own[7 * count] * c.k_position;
            i[n] = start[0];
            w_m[n] = start[1];
            x_m[n] = start[2];
            w_o[n] = start[3];
            x_o[n] = start[4];
            gained[n] = start[5];
            i_from[n] = start[6];
            z1[n] = low_pass[3];
            z2[n] = low_pass[4];
            cost[n] = 0.0;
        }
        for (int sample = 1; sample < samples; sample++) {
            const double d_command = (command[sample] - command[sample - 1]) * share;
            const double d_load = (load[sample] - load[sample - 1]) * share;
            for (int n = 0; n < LANES; n++) charge[n] = 0.0;
            for (int step = 0; step < substeps; step++) {
                const double command_now = command[sample - 1] + (step + 0.5) * d_command;
                const double load_now = load[sample - 1] + (step + 0.5) * d_load;
                const double load_size = std::fabs(load_now);
#pragma omp simd
                for (int n = 0; n < LANES; n++) {
                    double x_mid = x_m[n] + half * w_m[n];
                    // the shares of the step in which a and b are off
                    double per_step = 1.0 / clip(std::fabs(sectors * dt * w_m[n]), 1e-6, 1.0);
                    double from_b = x_mid * sectors - 2.0;
                    from_b -= 3.0 * std::floor(from_b * (1.0 / 3.0) + 0.5);
                    double from_a = from_b + (from_b < -0.5 ? 2.0 : -1.0);
                    double off_a = clip(0.5 + (0.5 - std::fabs(from_a)) * per_step, 0.0, 1.0);
                    double off_b = clip(0.5 + (0.5 - std::fabs(from_b)) * per_step, 0.0, 1.0);
                    double sine, cosine;
                    sincos_inline(x_mid, sine, cosine);
                    double along = cosine * zeta_cos[n] - sine * zeta_sin[n];
                    double across = half_sqrt3 * (sine * zeta_cos[n] + cosine * zeta_sin[n]);
                    double k_a = h_a[n] * std::fabs(1.0 + along);
                    double k_b = h_b[n] * std::fabs(1.0 - 0.5 * along + across);
                    double k_c = h_c[n] * std::fabs(1.0 - 0.5 * along - across);
                    double r = r_ab[n] + off_a * r_a[n] + off_b * r_b[n];
                    double reach = reach_ab[n] + off_a * reach_a[n] + off_b * reach_b[n];
                    double k = k_a + k_b + off_a * (k_c - k_a) + off_b * (k_c - k_b);
                    double slower = 1.0 - 0.5 * r * reach;  // what the current adds to the drop
                    reach *= slower < 0.5 ? 0.5 : slower;

                    double w_mid = w_m[n] + 0.5 * gained[n];
                    bool touching = std::fabs(std::fabs(x_m[n] - x_o[n]) - gap[n]) <= 1e-9;
                    double stiffness = g * half * k * (touching ? mobility_both : mobility_m);
                    stiffness = w_m[n] == 0.0 ? 0.0 : stiffness;
                    double w_ref = clip(k_w[n] * (command_now - x_o[n] - half * w_o[n]),
                                        -c.speed_limit, c.speed_limit);
                    double i_ref = (g * (w_ref - w_mid) + stiffness * i[n]) / (1.0 + stiffness);
                    i_ref = clip(i_ref, -c.current_limit, c.current_limit);
                    double drop = r * i[n] + k * w_m[n];
                    double fall = reach * (c.supply + drop), rise = reach * (c.supply - drop);
                    double after = clip(i_ref, i_from[n] - fall, i_from[n] + rise);
                    double before_m = k * i[n] - c.viscous * w_m[n];

                    double td_m = friction[n] * c.t_m;
                    double ts_m = c.static_ratio * td_m - k * c.half_band;
                    ts_m = ts_m < td_m ? td_m : ts_m;
                    double direction = w_o[n] != 0.0 ? w_o[n] : w_m[n];
                    double part = direction * load_now > 0.0 ? c.c_opposing : c.c_aiding;
                    double td_o = friction[n] * (c.t_o + part * load_size);
                    double ts_o = c.static_ratio * td_o;
                    double act_m = k * after - c.viscous * w_mid;
                    double act_o = -load_now;

                    double free_m = next_speed(w_m[n], act_m, per_m, ts_m, td_m);
                    double free_o = next_speed(w_o[n], act_o, per_o, ts_o, td_o);
                    double o_free = x_o[n] + half * (w_o[n] + free_o);
                    double twist = x_m[n] + half * (w_m[n] + free_m) - o_free;
                    double face = std::copysign(gap[n], twist);
                    double before = clip(x_m[n] - x_o[n], -gap[n], gap[n]);
                    bool rests = (free_m == 0.0) & (free_o == 0.0) &
                                 (std::fabs(std::fabs(before) - gap[n]) < 1e-12);
                    // apart the motor alone, else one body with the momentum and torques of both
                    bool apart = (std::fabs(twist) <= gap[n]) & !rests;
                    bool rolls = apart | (std::fabs(face - before) < 1e-12);
                    double met = rolls ? 0.0 : (face - before) / (twist - before);
                    double remains = rolls ? 0.0 : 1.0 - met;
                    double left = dt - met * dt, half_left = 0.5 * left;
                    double w_met = w_m[n] + met * (free_m - w_m[n]);
                    double x_met = x_m[n] + met * half * (w_m[n] + w_met);
                    double w = part_m * w_met + part_o * (w_o[n] + met * (free_o - w_o[n]));
                    w = apart ? w_m[n] : w;
                    double more = apart ? 0.0 : act_o;
                    // come to rest together, the motor leaves the face that it pushed
                    bool pushes = twist * w > 0.0, alone = apart | pushes;
                    double then = alone ? 0.0 : act_o, until;
                    Rest from = {act_m + then, before_m + then,
                                 alone ? mobility_m : mobility_both,
                                 alone ? ts_m : ts_m + ts_o, alone ? td_m : td_m + td_o};
                    double rate;
                    double v_m = through_rest(w, act_m + more, apart ? mobility_m : mobility_both,
                                              apart ? td_m : td_m + td_o, from, left, until, rate);
                    bool leaves = pushes & (until < 1.0);
                    double v_o = leaves ? 0.0 : v_m;
                    v_o = apart ? free_o : v_o;
                    gained[n] = dt * rate;
                    double m_next = x_met + half_left * (w + v_m);
                    double o_pushed = m_next - face;
                    double o_rests = x_met - face + half_left * until * w;
                    double o_next = leaves ? o_rests : o_pushed;
                    o_next = apart ? o_free : o_next;
                    o_next = clip(o_next, m_next - gap[n], m_next + gap[n]);

                    // after an impact the current goes for what the speed loop asks then
                    double asked = clip(i_ref - g * (w - w_met), -c.current_limit, c.current_limit);
                    asked -= after;
                    double change = clip(asked, -remains * fall, remains * rise);
                    double half_more = 0.5 * (asked > 0.0 ? rise : -fall);
                    double beside = 0.5 * remains * change;
                    i_from[n] = after + (remains > 0.0 ? change - half_more : 0.0);
                    i[n] = after + beside;
                    charge[n] += i[n];
                    double pushed = dt * k * beside * mobility_both;
                    v_m += pushed;
                    v_o += pushed;

                    double down = v_o < 0.0 ? 0.0 : v_o, up = v_o > 0.0 ? 0.0 : v_o;
                    v_o = o_next <= c.low ? down : (o_next >= c.high ? up : v_o);
                    x_o[n] = clip(o_next, c.low, c.high);
                    w_o[n] = v_o;
                    double low = c.low - gap[n], high = c.high + gap[n];
                    down = v_m < 0.0 ? 0.0 : v_m, up = v_m > 0.0 ? 0.0 : v_m;
                    v_m = m_next <= low ? down : (m_next >= high ? up : v_m);
                    x_m[n] = clip(m_next, low, high);
                    w_m[n] = v_m;
                }
            }
            for (int n = 0; n < LANES; n++) {
                double x = std::fabs(charge[n] * share);
                double y = b * x + z1[n];
                z1[n] = 2.0 * b * x - a1 * y + z2[n];
                z2[n] = b * x - a2 * y;
                double error = target[sample] - y;
                cost[n] += weights[sample] * error * error;
            }
        }
        for (int n = 0; n < LANES; n++) costs[first + n] = cost[n];
    }
}
