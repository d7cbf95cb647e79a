#include <math.h>
#include <string.h>

#include "gimbal_attitude.h"
#include "gimbal_controller.h"
#include "gimbal_guard.h"
#include "gimbal_law.h"
#include "gimbal_model.h"

/* Where the joints are and should be at one sample. */
struct fix {
    struct gimbal_aim aim;
    float v[GIMBAL_JOINTS];
    bool steep;
};

/* --- The turn to where the camera shall look ------------------------------------------------------------------------ */

/* Angles at which the camera looks as wanted from a base, by Newton; a longer step may end a turn away. */
static enum gimbal_obstacle reach(const struct gimbal_parameters *p, const float base[4], float q[GIMBAL_JOINTS])
{
    const int iterations = 40;
    const float stride = 0.3f;
    const float reached = 1e-6f;
    const float rounding = 1e-5f;
    float left[1] = {1.0f};
    struct gimbal_view view;
    memcpy(q, p->pace.home, sizeof p->pace.home);
    for (int i = 0; i < iterations && !(left[0] < reached); ++i) {
        float to[4 * GIMBAL_GYROS];
        gimbal_view(&p->limits, q, &view);
        gimbal_camera_between(q, to);
        gimbal_approach(&view, base, to, q, stride, left);
    }
    for (int j = 0; j < GIMBAL_JOINTS && left[0] < rounding && !view.steep; ++j) {
        if (q[j] < p->pace.lower[j] - rounding || q[j] > p->pace.upper[j] + rounding) {
            return GIMBAL_LIMIT;
        }
    }
    return !(left[0] < rounding) ? GIMBAL_UNREACHED : view.steep ? GIMBAL_STEEP : GIMBAL_NONE;
}

/* The way from angles to where the camera shall look. */
static void set_out(const struct gimbal_parameters *p, const float base[4], const float q[GIMBAL_JOINTS],
                    struct gimbal_way *out)
{
    const struct gimbal_pace *pace = &p->pace;
    float longest = 0.0f;
    float quickest = 1.0f / pace->ramp;
    float hardest = 1e30f;
    const enum gimbal_obstacle obstacle = reach(p, base, out->goal);
    memcpy(out->base, base, sizeof out->base);
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        out->way[j] = out->goal[j] - q[j];
        longest = fmaxf(longest, fabsf(out->way[j]));
    }
    out->on = longest > pace->near && longest < 1e6f; /* nor is what is no number */
    out->obstacle = out->on ? obstacle : GIMBAL_NONE;
    for (int j = 0; j < GIMBAL_JOINTS && out->on; ++j) {
        float moment = 0.0f;
        for (int k = 0; k < GIMBAL_JOINTS; ++k) {
            moment += pace->inertia[GIMBAL_JOINTS * j + k] * fabsf(out->way[k]);
        }
        quickest = fminf(quickest, pace->rate[j] / fmaxf(fabsf(out->way[j]), 1e-12f));
        hardest = fminf(hardest, pace->torque[j] / fmaxf(moment, 1e-12f));
    }
    out->rate = fminf(quickest, sqrtf(hardest / 1.5f));
    out->ramp = fmaxf(1.5f * out->rate / hardest, pace->ramp);
}

/* Where the camera should look so long after the last sample; it is kept as wanted where there is no way to go. */
static void gaze_now(const struct gimbal_holding *state, float later, struct gimbal_gaze *out)
{
    const struct gimbal_way *way = &state->way;
    const float since = 1e-6f * (float)state->time_us + later;
    *out = (struct gimbal_gaze){.attitude = {1.0f}};
    if (way->on && since < 1.0f / way->rate + way->ramp) {
        gimbal_gaze(way, since, out);
    }
}

/* --- Attitude: the camera's own gyro, and the others with the encoders between ------------------------------------- */

static const float *gyro(const struct gimbal_sensors *seen, int i)
{
    return i == 0 ? seen->base_gyro : seen->link_gyro[i - 1];
}

static void set(struct gimbal_attitude *attitude, const float q[4])
{
    *attitude = (struct gimbal_attitude){.q = {q[0], q[1], q[2], q[3]}};
}

/* Begin to fuse from the base's attitude in the wanted frame; to: of the camera in every link with a gyro. */
static void begin(struct gimbal_holding *state, const struct gimbal_sensors *seen, const float to[4 * GIMBAL_GYROS],
                  const struct gimbal_attitude *base)
{
    const struct gimbal_attitude kept = *base;
    float camera[4];
    gimbal_product(kept.q, to, camera);
    for (int i = 0; i < GIMBAL_GYROS; ++i) {
        float back[4];
        float attitude[4];
        gimbal_inverse(&to[4 * i], back);
        gimbal_product(camera, back, attitude);
        set(&state->others[i], attitude);
        memcpy(state->other_rates[i], gyro(seen, i), sizeof state->other_rates[i]);
    }
    memset(state->gaps, 0, sizeof state->gaps);
    memset(state->slow_gaps, 0, sizeof state->slow_gaps);
    memset(state->turn, 0, sizeof state->turn);
    state->others[0] = kept; /* to the last digit, however often this is done */
}

/* Turn an attitude by a gyro's reading and the one before it. */
static void integrate(struct gimbal_attitude *attitude, float before[3], const float now[3], float elapsed)
{
    float turn[3];
    for (int k = 0; k < 3; ++k) {
        turn[k] = (before[k] + now[k]) * (0.5f * elapsed);
        before[k] = now[k];
    }
    gimbal_turn(attitude, turn);
}

/* While a sensor is in doubt every attitude comes from what is left. */
static void unfused(struct gimbal_holding *state, const struct gimbal_sensors *seen,
                    const float to[4 * GIMBAL_GYROS])
{
    const struct gimbal_guard *guard = &state->guard;
    const bool encoders = gimbal_guard_doubtful(guard, GIMBAL_ENCODERS);
    const bool base_gyro = gimbal_guard_doubtful(guard, GIMBAL_BASE_GYRO);
    float found[4];
    struct gimbal_attitude base = state->others[0];
    gimbal_turn(&state->attitude, state->turn); /* what fusion knows by now is kept */
    if (gimbal_guard_doubtful(guard, GIMBAL_CAMERA_GYRO) && !base_gyro && !encoders) {
        gimbal_product(base.q, to, found);
        set(&state->attitude, found);
    } else if (base_gyro && !encoders) {
        float back[4];
        gimbal_inverse(to, back);
        gimbal_product(state->attitude.q, back, found);
        set(&base, found);
    }
    begin(state, seen, to, &base);
}

/* Compare the camera's attitude with what the other gyros make of it; rate: what to add to the camera's, rad/s. */
static void compare(const struct gimbal_parameters *p, struct gimbal_holding *state, const float to[4 * GIMBAL_GYROS],
                    float rate[3])
{
    float turn[3] = {0.0f, 0.0f, 0.0f};
    for (int i = 0; i < GIMBAL_GYROS; ++i) {
        float *gap = &state->gaps[3 * i];
        float apart[1];
        gimbal_fusion(p, state->attitude.q, state->others[i].q, &to[4 * i], gap, &state->slow_gaps[3 * i], apart);
        state->apart = state->apart || apart[0] > 0.0f;
        for (int k = 0; k < 3; ++k) {
            turn[k] += gap[k] / (float)(GIMBAL_GYROS + 1);
        }
    }
    for (int k = 0; k < 3 && !state->apart; ++k) { /* apart once, for good: the turn stays as it was */
        rate[k] = (turn[k] - state->turn[k]) / p->dt;
        state->turn[k] = turn[k];
    }
}

/* The camera's attitude; rate: what to add to its rate, rad/s. */
static void estimate(const struct gimbal_parameters *p, struct gimbal_holding *state,
                     const struct gimbal_sensors *seen, float elapsed, float attitude[4], float rate[3])
{
    struct gimbal_attitude actual;
    float to[4 * GIMBAL_GYROS];
    bool doubtful = false;
    memset(rate, 0, 3 * sizeof *rate);
    gimbal_camera_between(seen->q, to);
    integrate(&state->attitude, state->turning, seen->camera_gyro, elapsed);
    if (p->fusion_gain > 0.0f) {
        for (int i = 0; i < GIMBAL_GYROS; ++i) {
            integrate(&state->others[i], state->other_rates[i], gyro(seen, i), elapsed);
        }
        for (int channel = 0; channel < GIMBAL_CHANNELS; ++channel) {
            doubtful = doubtful || gimbal_guard_doubtful(&state->guard, (enum gimbal_channel)channel);
        }
        if (doubtful) {
            unfused(state, seen, to);
        } else if (!state->apart) {
            compare(p, state, to, rate);
        }
    }
    actual = state->attitude;
    gimbal_turn(&actual, state->turn);
    if (state->upright.eased > 0.0f) {
        gimbal_level(p, &state->upright, to, seen->base_force, actual.q);
    }
    memcpy(attitude, actual.q, sizeof actual.q);
}

/* --- The base's motion ahead --------------------------------------------------------------------------------------- */

static void remember(struct gimbal_holding *state, const struct gimbal_sensors *seen)
{
    state->newest = (state->newest + GIMBAL_TAPS - 1) % GIMBAL_TAPS;
    for (int k = 0; k < 3; ++k) {
        state->past[state->newest][k] = seen->base_gyro[k];
        state->past[state->newest][3 + k] = seen->base_force[k];
    }
}

/* The base's rate, angular acceleration and force when the torque of a lead acts, from the last samples. */
static void foresee(const struct gimbal_parameters *p, const struct gimbal_holding *state, int lead,
                    struct gimbal_ahead *out)
{
    *out = (struct gimbal_ahead){.w = {0.0f}};
    for (int tap = 0; tap < GIMBAL_TAPS; ++tap) {
        const float *past = state->past[(state->newest + tap) % GIMBAL_TAPS];
        for (int k = 0; k < 3; ++k) {
            out->w[k] += p->forecast[lead][0][tap] * past[k];
            out->dw[k] += p->forecast[lead][1][tap] * past[k];
            out->f[k] += p->forecast[lead][2][tap] * past[3 + k];
        }
    }
}

/* What was foreseen at every lead, as far as it is trusted, and what it asks of the joints. */
static void look_ahead(const struct gimbal_parameters *p, struct gimbal_holding *state,
                       const struct gimbal_sensors *seen, const struct gimbal_view *first, struct fix *fix)
{
    const float *before = state->past[(state->newest + 1) % GIMBAL_TAPS];
    struct gimbal_ahead none;
    struct gimbal_ahead *there = fix->aim.ahead;
    gimbal_trust(p, &p->judging, state->past[state->newest], before, state->due[0], state, &none);
    for (int lead = 0; lead < GIMBAL_LEADS; ++lead) {
        foresee(p, state, lead, &there[lead]);
    }
    memmove(state->due[0], state->due[1], (GIMBAL_DUE - 1) * sizeof state->due[0]);
    for (int k = 0; k < 3; ++k) {
        float *due = &state->due[GIMBAL_DUE - 1][k];
        due[0] = there[GIMBAL_LEADS - 1].dw[k];
        due[3] = there[GIMBAL_LEADS - 1].f[k];
        due[6] = none.dw[k];
        due[9] = none.f[k];
    }
    for (int lead = 0; lead < GIMBAL_LEADS; ++lead) {
        struct gimbal_view view = *first;
        struct gimbal_gaze gaze;
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            there[lead].q[j] = seen->q[j] + p->holding_lead[lead] * fix->v[j];
        }
        if (p->holding_lead[lead] > p->holding_lead[0]) {
            gimbal_view(&p->limits, there[lead].q, &view);
        }
        gaze_now(state, p->holding_lead[lead], &gaze);
        gimbal_wish(state, &view, &gaze, &none, &there[lead]);
    }
}

/* --- One sample ---------------------------------------------------------------------------------------------------- */

/* From the sensors to where the joints are and should be. */
static void navigate(const struct gimbal_parameters *p, struct gimbal_holding *state,
                     const struct gimbal_sensors *seen, float elapsed, struct fix *fix)
{
    struct gimbal_view view;
    struct gimbal_gaze gaze;
    float q[GIMBAL_JOINTS];
    float attitude[4];
    float rate[3];
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        q[j] = seen->q[j] + p->holding_lead[0] * state->v[j];
    }
    gimbal_view(&p->limits, q, &view);
    fix->steep = view.steep;
    gaze_now(state, 0.0f, &gaze);
    estimate(p, state, seen, elapsed, attitude, rate);
    gimbal_aim_joints(&view, &gaze, seen, attitude, rate, &fix->aim, fix->v);
    memcpy(state->v, fix->v, sizeof state->v);
    if (p->law == GIMBAL_COMPUTED_TORQUE) {
        remember(state, seen);
        look_ahead(p, state, seen, &view, fix);
    }
}

/* What a lost camera gyro would say, by the base's gyro and the encoders' rates; without that the base stands. */
static void stand_in(const struct gimbal_holding *state, struct gimbal_sensors *seen)
{
    const float none[3] = {0.0f, 0.0f, 0.0f};
    const bool stands = gimbal_guard_lost(&state->guard, GIMBAL_BASE_GYRO);
    gimbal_camera_rate(seen->q, state->guard.rates, stands ? none : seen->base_gyro, seen->camera_gyro);
}

/* Begin the fallback where the last torque leaves off: its integral holds what the model gave. */
static void take_over(const struct gimbal_parameters *p, struct gimbal_holding *state, const float q[],
                      const struct fix *fix)
{
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const struct gimbal_loop *loop = &p->fallback[j];
        const float error = fix->aim.q[j] - q[j];
        const float rate = fix->aim.v[j] - fix->v[j];
        const float wanted = state->tau[j] / loop->inertia - loop->kp * error - loop->kd * rate;
        state->memory.integral[j] = loop->ki > 0.0f ? wanted / loop->ki : 0.0f;
    }
}

static void begin_law(struct gimbal_memory *memory)
{
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        memory->integral[j] = 0.0f;
        memory->owed[j] = 0.0f;
    }
}

/* The law that is in force, or the fallback where an IMU is lost. */
static void command(const struct gimbal_parameters *p, struct gimbal_holding *state, const float q[],
                    const struct fix *fix, float tau[GIMBAL_JOINTS])
{
    const struct gimbal_guard *guard = &state->guard;
    const bool back = gimbal_guard_lost(guard, GIMBAL_CAMERA_GYRO) || gimbal_guard_lost(guard, GIMBAL_BASE_GYRO) ||
                      gimbal_guard_lost(guard, GIMBAL_BASE_FORCE);
    if (back != state->fallback) {
        begin_law(&state->memory);
        if (back) {
            take_over(p, state, q, fix);
        }
        state->fallback = back;
    }
    if (back || p->law == GIMBAL_PID) {
        const struct gimbal_loop *loop = back ? p->fallback : p->holding;
        const struct gimbal_robust none = {.gain = 0.0f};
        const float still[GIMBAL_JOINTS] = {0.0f};
        struct gimbal_error error;
        float y[GIMBAL_JOINTS];
        gimbal_feedback(p, loop, &none, q, fix->v, fix->aim.q, fix->aim.v, state->memory.integral, still, &error, y);
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            y[j] *= loop[j].inertia; /* N m */
        }
        gimbal_cut_torque(p, loop, &error, y, state->memory.integral, tau);
        return;
    }
    gimbal_hold(p, &state->memory, 1e-6f * (float)state->time_us, q, fix->v, &fix->aim, tau);
}

/* A torque that is no number becomes none, and the law begins anew; a limiter may make a limit of what is no number,
   so what went in is looked at, too. */
static void refuse(const struct gimbal_parameters *p, struct gimbal_holding *state, const struct fix *fix,
                   float tau[GIMBAL_JOINTS])
{
    bool numbers = gimbal_finite(tau, GIMBAL_JOINTS) && gimbal_finite(fix->aim.q, GIMBAL_JOINTS) &&
                   gimbal_finite(state->memory.integral, GIMBAL_JOINTS);
    if (p->law == GIMBAL_COMPUTED_TORQUE) {
        numbers = numbers && gimbal_finite(fix->aim.ahead[0].a, GIMBAL_JOINTS);
    }
    if (numbers) {
        state->unanswered = 0u;
        return;
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        tau[j] = 0.0f;
    }
    begin_law(&state->memory);
    state->fallback = false;
    state->refused += 1u;
    state->unanswered += 1u;
}

/* Attitudes of camera and base, and the direction that points up, as seen from the attitude that is wanted. */
static void relate(const float wanted[4], const struct gimbal_attitudes *known, float camera[4], float base[4],
                   float up[3])
{
    const float *w = wanted;
    float back[4];
    gimbal_inverse(wanted, back);
    gimbal_product(back, known->camera, camera);
    gimbal_product(back, known->base, base);
    up[0] = 2.0f * (w[1] * w[3] - w[0] * w[2]);
    up[1] = 2.0f * (w[2] * w[3] + w[0] * w[1]);
    up[2] = w[0] * w[0] - w[1] * w[1] - w[2] * w[2] + w[3] * w[3];
}

static void begin_upright(struct gimbal_upright *upright, float eased)
{
    upright->eased = eased;
    upright->samples = 0.0f;
    memset(upright->means, 0, sizeof upright->means);
}

/* Begin anew at the last sample, holding what the camera sees: the attitude that was known is no number any more.
   Where up is is what it was; it is corrected slowly. */
static void restart(const struct gimbal_parameters *p, struct gimbal_holding *state)
{
    struct gimbal_attitudes known;
    struct gimbal_sensors last = state->guard.good;
    struct gimbal_upright upright = state->upright;
    const int64_t time_us = state->time_us;
    const uint32_t refused = state->refused;
    const uint32_t distrusted = state->distrusted;
    gimbal_attitudes_now(last.q, &known);
    last.time_us += p->dt_us; /* of the sample to come, as a start is */
    gimbal_holding_start(p, state, &last, &known);
    begin_upright(&upright, upright.eased > 0.0f ? p->level_span * p->dt : 0.0f);
    state->upright = upright;
    state->time_us = time_us;
    state->refused = refused;
    state->distrusted = distrusted;
}

static void report(const struct gimbal_parameters *p, struct gimbal_holding *state, bool steep, const float tau[])
{
    bool limited = false;
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        limited = limited || fabsf(tau[j]) >= p->limit[j];
        state->tau[j] = tau[j];
    }
    state->limited = limited ? state->limited + 1u : 0u;
    state->steep = steep;
    state->lost = 0u;
    for (int channel = 0; channel < GIMBAL_CHANNELS; ++channel) {
        if (gimbal_guard_lost(&state->guard, (enum gimbal_channel)channel)) {
            state->lost |= 1u << channel;
        }
        if (gimbal_guard_doubtful(&state->guard, (enum gimbal_channel)channel)) {
            state->distrusted |= 1u << channel;
        }
    }
}

void gimbal_attitudes_now(const float q[GIMBAL_JOINTS], struct gimbal_attitudes *out)
{
    float to[4 * GIMBAL_GYROS];
    gimbal_camera_between(q, to);
    *out = (struct gimbal_attitudes){.base = {1.0f}};
    memcpy(out->camera, to, sizeof out->camera);
    memcpy(out->wanted, to, sizeof out->wanted);
}

void gimbal_attitudes_level(const struct gimbal_parameters *p, const struct gimbal_sensors *seen,
                            struct gimbal_attitudes *out)
{
    const float *f = seen->base_force;
    const float roll = 0.5f * atan2f(f[1], f[2]);
    const float pitch = 0.5f * atan2f(-f[0], sqrtf(f[1] * f[1] + f[2] * f[2]));
    const float base[4] = {cosf(pitch) * cosf(roll), cosf(pitch) * sinf(roll), sinf(pitch) * cosf(roll),
                           -sinf(pitch) * sinf(roll)};
    float camera[4];
    gimbal_attitudes_now(seen->q, out);
    if (gimbal_finite(base, 4)) {
        gimbal_product(base, out->camera, camera);
        memcpy(out->base, base, sizeof base);
        memcpy(out->camera, camera, sizeof camera);
        memcpy(out->wanted, camera, sizeof camera);
    }
    out->eased = p->level_eased;
}

void gimbal_holding_start(const struct gimbal_parameters *p, struct gimbal_holding *state,
                          const struct gimbal_sensors *seen, const struct gimbal_attitudes *known)
{
    float to[4 * GIMBAL_GYROS];
    float camera[4];
    float q[4];
    struct gimbal_attitude base;
    memset(state, 0, sizeof *state);
    gimbal_guard_start(&p->limits, &state->guard, seen, p->dt_us);
    const struct gimbal_sensors *good = &state->guard.good;
    relate(known->wanted, known, camera, q, state->upright.up);
    set_out(p, q, good->q, &state->way);
    if (state->way.obstacle != GIMBAL_NONE) {
        relate(known->camera, known, camera, q, state->upright.up);
        state->way.on = false;
    }
    begin_upright(&state->upright, known->eased);
    set(&state->attitude, camera);
    set(&base, q);
    gimbal_camera_between(good->q, to);
    begin(state, good, to, &base);
    memcpy(state->turning, good->camera_gyro, sizeof state->turning);
    for (int tap = 0; tap < GIMBAL_TAPS; ++tap) {
        remember(state, good);
    }
    for (int i = 0; i < GIMBAL_DUE; ++i) {
        memcpy(&state->due[i][3], good->base_force, sizeof good->base_force);
        memcpy(&state->due[i][9], good->base_force, sizeof good->base_force);
    }
    state->time_us = -(int64_t)p->dt_us;
}

void gimbal_holding_step(const struct gimbal_parameters *p, struct gimbal_holding *state,
                         const struct gimbal_sensors *seen, float tau[GIMBAL_JOINTS])
{
    struct fix fix;
    const uint32_t elapsed_us = gimbal_guard_step(&p->limits, &state->guard, seen, p->dt_us, state->v, state->steep);
    struct gimbal_sensors good = state->guard.good;
    state->time_us += (int64_t)elapsed_us;
    if (gimbal_guard_lost(&state->guard, GIMBAL_CAMERA_GYRO)) {
        stand_in(state, &good);
    }
    /* The first sample is that of the start: nothing has turned since. */
    navigate(p, state, &good, state->time_us > 0 ? 1e-6f * (float)elapsed_us : 0.0f, &fix);
    command(p, state, good.q, &fix, tau);
    if (gimbal_guard_lost(&state->guard, GIMBAL_ENCODERS) && gimbal_guard_lost(&state->guard, GIMBAL_CAMERA_GYRO)) {
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            tau[j] = 0.0f;
        }
    }
    refuse(p, state, &fix, tau);
    report(p, state, fix.steep, tau);
    if (state->unanswered >= (uint32_t)p->limits.held &&
        !gimbal_guard_doubtful(&state->guard, GIMBAL_ENCODERS) &&
        !gimbal_guard_doubtful(&state->guard, GIMBAL_CAMERA_GYRO)) {
        restart(p, state);
    }
}
