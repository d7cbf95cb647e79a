#include <math.h>
#include <string.h>

#include "gimbal_attitude.h"
#include "gimbal_controller.h"
#include "gimbal_guard.h"
#include "gimbal_law.h"
#include "gimbal_model.h"

/* Rows of the camera's Jacobian that the rig commands: all three, or of two axes those across the line of sight. */
enum { COMMANDED = GIMBAL_JOINTS > 2 ? 3 : 2, FIRST = 3 - COMMANDED };

/* The camera at some angles. */
struct view {
    float R[9];                         /* its attitude in the base link */
    float J[3 * GIMBAL_JOINTS];         /* of its rate in its own frame */
    float against[3 * GIMBAL_JOINTS];   /* rates of the joints that undo a turn of the camera, joint by joint */
    bool steep;                         /* whether the inverse was damped */
};

/* Where the camera should look at one moment. */
struct gaze {
    float attitude[4]; /* in the wanted frame */
    float w[3];        /* rate in its own frame, rad/s */
    float dw[3];       /* angular acceleration in its own frame, rad/s^2 */
};

/* Where the joints are and should be at one sample. */
struct fix {
    struct gimbal_aim aim;
    float v[GIMBAL_JOINTS];
    bool steep;
};

/* --- Kinematics --------------------------------------------------------------------------------------------------- */

/* Inverse of three rows of three entries by cofactors; false where there is none, or a steep one. */
static bool cofactors(const float J[], float steepest, float inverse[])
{
    const float c[9] = {
        J[4] * J[8] - J[5] * J[7], J[2] * J[7] - J[1] * J[8], J[1] * J[5] - J[2] * J[4],
        J[5] * J[6] - J[3] * J[8], J[0] * J[8] - J[2] * J[6], J[2] * J[3] - J[0] * J[5],
        J[3] * J[7] - J[4] * J[6], J[1] * J[6] - J[0] * J[7], J[0] * J[4] - J[1] * J[3],
    };
    const float size = J[0] * c[0] + J[1] * c[3] + J[2] * c[6];
    float most = 0.0f;
    for (int i = 0; i < 9; ++i) {
        most = fmaxf(most, fabsf(c[i]));
    }
    if (!(most < steepest * fabsf(size)) || fabsf(size) < 1e-9f) {
        return false;
    }
    for (int i = 0; i < 9; ++i) {
        inverse[i] = c[i] / size;
    }
    return true;
}

/* J^T (J J^T + damping^2 I)^-1 of the commanded rows, by Cholesky's factors; false where the sum is singular.
   inverse: (joints, COMMANDED); size: product of the squared pivots, the determinant of the sum. */
static bool squared(const float J[3 * GIMBAL_JOINTS], float damping, float inverse[COMMANDED * GIMBAL_JOINTS],
                    float *size)
{
    float L[COMMANDED][COMMANDED];
    *size = 1.0f;
    for (int r = 0; r < COMMANDED; ++r) {
        for (int c = 0; c <= r; ++c) {
            float sum = r == c ? damping * damping : 0.0f;
            for (int j = 0; j < GIMBAL_JOINTS; ++j) {
                sum += J[(FIRST + r) * GIMBAL_JOINTS + j] * J[(FIRST + c) * GIMBAL_JOINTS + j];
            }
            for (int k = 0; k < c; ++k) {
                sum -= L[r][k] * L[c][k];
            }
            if (r == c && !(sum > 0.0f)) {
                return false;
            }
            L[r][c] = r == c ? sqrtf(sum) : sum / L[c][c];
        }
        *size *= L[r][r] * L[r][r];
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        float *x = &inverse[COMMANDED * j];
        for (int r = 0; r < COMMANDED; ++r) {
            float sum = J[(FIRST + r) * GIMBAL_JOINTS + j];
            for (int k = 0; k < r; ++k) {
                sum -= L[r][k] * x[k];
            }
            x[r] = sum / L[r][r];
        }
        for (int r = COMMANDED - 1; r >= 0; --r) {
            float sum = x[r];
            for (int k = r + 1; k < COMMANDED; ++k) {
                sum -= L[k][r] * x[k];
            }
            x[r] = sum / L[r][r];
        }
    }
    return true;
}

/* Inverse of the commanded rows, (joints, COMMANDED); true where it is steep and damped. */
static bool inverted(const struct gimbal_limits *limits, const float J[3 * GIMBAL_JOINTS],
                     float inverse[COMMANDED * GIMBAL_JOINTS])
{
    float size;
    if (GIMBAL_JOINTS == 3) {
        if (cofactors(J, limits->steep, inverse)) {
            return false;
        }
    } else if (squared(J, 0.0f, inverse, &size) && size > powf(limits->steep, -2.0f * (float)COMMANDED)) {
        float most = 0.0f;
        for (int i = 0; i < COMMANDED * GIMBAL_JOINTS; ++i) {
            most = fmaxf(most, fabsf(inverse[i]));
        }
        if (most < limits->steep) {
            return false;
        }
    }
    if (!squared(J, limits->damping, inverse, &size)) {
        for (int i = 0; i < COMMANDED * GIMBAL_JOINTS; ++i) {
            inverse[i] = 0.0f;
        }
    }
    return true;
}

static void look(const struct gimbal_limits *limits, const float q[GIMBAL_JOINTS], struct view *out)
{
    float inverse[COMMANDED * GIMBAL_JOINTS];
    gimbal_camera(q, out->R, out->J);
    out->steep = inverted(limits, out->J, inverse);
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        for (int i = 0; i < 3; ++i) {
            out->against[3 * j + i] = 0.0f;
        }
        for (int row = 0; row < COMMANDED; ++row) {
            out->against[3 * j + FIRST + row] = -inverse[COMMANDED * j + row];
        }
    }
}

/* Rates of the joints that undo a turn of the camera. */
static void undo(const struct view *view, const float turn[3], float out[GIMBAL_JOINTS])
{
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const float *row = &view->against[3 * j];
        out[j] = row[0] * turn[0] + row[1] * turn[1] + row[2] * turn[2];
    }
}

/* Attitudes of the camera in the base link and in every link between that has a gyro. */
static void between(const float q[GIMBAL_JOINTS], float out[GIMBAL_GYROS][4])
{
    float R[9 * GIMBAL_GYROS];
    gimbal_camera_between(q, R);
    for (int i = 0; i < GIMBAL_GYROS; ++i) {
        gimbal_quaternion(&R[9 * i], out[i]);
    }
}

/* --- The turn to where the camera shall look ------------------------------------------------------------------------ */

/* Angles at which the camera looks as wanted from a base, by Newton; a longer step may end a turn away. */
static enum gimbal_obstacle reach(const struct gimbal_parameters *p, const float base[4], float q[GIMBAL_JOINTS])
{
    const int iterations = 40;
    const float rounding = 1e-5f;
    float error = 0.0f;
    bool steep = false;
    const float stride = 0.3f;
    const float reached = 1e-6f;
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        q[j] = p->pace.home[j];
    }
    for (int i = 0; i < iterations; ++i) {
        struct view view;
        float camera[4];
        float attitude[4];
        float left[3];
        float step[GIMBAL_JOINTS];
        float most = 1e-12f;
        look(&p->limits, q, &view);
        steep = view.steep;
        error = 0.0f;
        gimbal_quaternion(view.R, camera);
        gimbal_product(base, camera, attitude);
        gimbal_log(attitude, left);
        for (int k = FIRST; k < 3; ++k) {
            error = fmaxf(error, fabsf(left[k]));
        }
        if (error < reached) {
            break;
        }
        undo(&view, left, step);
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            most = fmaxf(most, fabsf(step[j]));
        }
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            q[j] += step[j] * fminf(1.0f, stride / most);
        }
    }
    for (int j = 0; j < GIMBAL_JOINTS && error < rounding && !steep; ++j) {
        if (q[j] < p->pace.lower[j] - rounding || q[j] > p->pace.upper[j] + rounding) {
            return GIMBAL_LIMIT;
        }
    }
    return !(error < rounding) ? GIMBAL_UNREACHED : steep ? GIMBAL_STEEP : GIMBAL_NONE;
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
    for (int k = 0; k < 4; ++k) {
        out->base[k] = base[k];
    }
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

/* Time from the start of a way to its end, s. */
static float duration(const struct gimbal_way *way)
{
    return 1.0f / way->rate + way->ramp;
}

/* Where the camera should look so long after the start. */
static void gaze_at(const struct gimbal_way *way, float since, struct gaze *out)
{
    const float none[3] = {0.0f, 0.0f, 0.0f};
    const float left = fmaxf(duration(way) - since, 0.0f);
    const float near = fminf(since, left);
    const float x = fminf(near / way->ramp, 1.0f);
    const float gone = way->rate * (way->ramp * x * x * x * (1.0f - 0.5f * x) + fmaxf(near - way->ramp, 0.0f));
    const float speed = way->rate * x * x * (3.0f - 2.0f * x);
    const float swing = way->rate / way->ramp * 6.0f * x * (1.0f - x);
    const bool rises = since < left;
    float R[9];
    float J[3 * GIMBAL_JOINTS];
    float camera[4];
    float q[GIMBAL_JOINTS];
    float v[GIMBAL_JOINTS];
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        q[j] = way->goal[j] + (rises ? gone - 1.0f : -gone) * way->way[j];
        v[j] = speed * way->way[j];
    }
    gimbal_camera(q, R, J);
    gimbal_quaternion(R, camera);
    gimbal_product(way->base, camera, out->attitude);
    gimbal_camera_drift(q, v, none, none, out->dw);
    for (int i = 0; i < 3; ++i) {
        out->w[i] = 0.0f;
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            out->w[i] += J[i * GIMBAL_JOINTS + j] * v[j];
            out->dw[i] += J[i * GIMBAL_JOINTS + j] * (rises ? swing : -swing) * way->way[j];
        }
    }
}

/* Where the camera should look so long after the last sample; it is kept as wanted where there is no way to go. */
static void gaze_now(const struct gimbal_holding *state, float later, struct gaze *out)
{
    const float since = 1e-6f * (float)state->time_us + later;
    if (state->way.on && since < duration(&state->way)) {
        gaze_at(&state->way, since, out);
        return;
    }
    for (int k = 0; k < 3; ++k) {
        out->attitude[1 + k] = 0.0f;
        out->w[k] = 0.0f;
        out->dw[k] = 0.0f;
    }
    out->attitude[0] = 1.0f;
}

/* --- Attitude: the camera's own gyro, and the others with the encoders between ------------------------------------- */

static const float *gyro(const struct gimbal_sensors *seen, int i)
{
    return i == 0 ? seen->base_gyro : seen->link_gyro[i - 1];
}

static void set(struct gimbal_attitude *attitude, const float q[4])
{
    for (int k = 0; k < 4; ++k) {
        attitude->q[k] = q[k];
        attitude->rest[k] = 0.0f;
    }
}

/* Begin to fuse from the base's attitude in the wanted frame. */
static void begin(struct gimbal_holding *state, const struct gimbal_sensors *seen, const struct gimbal_attitude *base)
{
    const struct gimbal_attitude kept = *base;
    float to[GIMBAL_GYROS][4];
    float camera[4];
    between(seen->q, to);
    gimbal_product(kept.q, to[0], camera);
    for (int i = 0; i < GIMBAL_GYROS; ++i) {
        float back[4];
        float attitude[4];
        gimbal_inverse(to[i], back);
        gimbal_product(camera, back, attitude);
        set(&state->others[i], attitude);
        for (int k = 0; k < 3; ++k) {
            state->other_rates[i][k] = gyro(seen, i)[k];
            state->gaps[i][k] = 0.0f;
            state->slow_gaps[i][k] = 0.0f;
            state->turn[k] = 0.0f;
        }
    }
    state->others[0] = kept; /* to the last digit, however often this is done */
}

/* Integrate the other gyros. */
static void others_on(struct gimbal_holding *state, const struct gimbal_sensors *seen, float elapsed)
{
    for (int i = 0; i < GIMBAL_GYROS; ++i) {
        float turn[3];
        for (int k = 0; k < 3; ++k) {
            turn[k] = (state->other_rates[i][k] + gyro(seen, i)[k]) * (0.5f * elapsed);
            state->other_rates[i][k] = gyro(seen, i)[k];
        }
        gimbal_turn(&state->others[i], turn);
    }
}

/* While a sensor is in doubt every attitude comes from what is left. */
static void unfused(struct gimbal_holding *state, const struct gimbal_sensors *seen)
{
    const struct gimbal_guard *guard = &state->guard;
    const bool encoders = gimbal_guard_doubtful(guard, GIMBAL_ENCODERS);
    const bool base_gyro = gimbal_guard_doubtful(guard, GIMBAL_BASE_GYRO);
    float to[GIMBAL_GYROS][4];
    float found[4];
    struct gimbal_attitude base = state->others[0];
    between(seen->q, to);
    gimbal_turn(&state->attitude, state->turn); /* what fusion knows by now is kept */
    if (gimbal_guard_doubtful(guard, GIMBAL_CAMERA_GYRO) && !base_gyro && !encoders) {
        gimbal_product(base.q, to[0], found);
        set(&state->attitude, found);
    } else if (base_gyro && !encoders) {
        float back[4];
        gimbal_inverse(to[0], back);
        gimbal_product(state->attitude.q, back, found);
        set(&base, found);
    }
    begin(state, seen, &base);
}

/* Compare the camera's attitude with what the other gyros make of it; rate: what to add to the camera's, rad/s. */
static void compare(const struct gimbal_parameters *p, struct gimbal_holding *state, const float q[GIMBAL_JOINTS],
                    float rate[3])
{
    float to[GIMBAL_GYROS][4];
    float own[4];
    float turn[3] = {0.0f, 0.0f, 0.0f};
    if (state->apart) {
        return;
    }
    between(q, to);
    gimbal_inverse(state->attitude.q, own);
    for (int i = 0; i < GIMBAL_GYROS; ++i) {
        float link[4];
        float gap[4];
        float seen[3];
        gimbal_product(own, state->others[i].q, link);
        gimbal_product(link, to[i], gap);
        gimbal_log(gap, seen);
        for (int k = 0; k < 3; ++k) {
            state->gaps[i][k] += p->fusion_gain * (seen[k] - state->gaps[i][k]);
            state->slow_gaps[i][k] += p->fusion_share * (state->gaps[i][k] - state->slow_gaps[i][k]);
            state->apart = state->apart || fabsf(state->gaps[i][k] - state->slow_gaps[i][k]) > p->fusion_bound;
            turn[k] += state->gaps[i][k] / (float)(GIMBAL_GYROS + 1);
        }
    }
    if (state->apart) {
        return; /* for good; the turn stays as it was */
    }
    for (int k = 0; k < 3; ++k) {
        rate[k] = (turn[k] - state->turn[k]) / p->dt;
        state->turn[k] = turn[k];
    }
}

/* Turn of the camera from where it should look, rad; rate: what to add to its rate, rad/s. */
static void estimate(const struct gimbal_parameters *p, struct gimbal_holding *state,
                     const struct gimbal_sensors *seen, float elapsed, const struct gaze *gaze, float turn[3],
                     float rate[3])
{
    struct gimbal_attitude actual;
    float wanted[4];
    float off[4];
    for (int k = 0; k < 3; ++k) {
        turn[k] = (state->turning[k] + seen->camera_gyro[k]) * (0.5f * elapsed);
        state->turning[k] = seen->camera_gyro[k];
        rate[k] = 0.0f;
    }
    gimbal_turn(&state->attitude, turn);
    if (p->fusion_gain > 0.0f) {
        bool doubtful = false;
        others_on(state, seen, elapsed);
        for (int channel = 0; channel < GIMBAL_CHANNELS; ++channel) {
            doubtful = doubtful || gimbal_guard_lost(&state->guard, (enum gimbal_channel)channel) ||
                       gimbal_guard_doubtful(&state->guard, (enum gimbal_channel)channel);
        }
        if (doubtful) {
            unfused(state, seen);
        } else {
            compare(p, state, seen->q, rate);
        }
    }
    actual = state->attitude;
    gimbal_turn(&actual, state->turn);
    if (state->upright.eased > 0.0f) {
        gimbal_level(p, &state->upright, seen->q, seen->base_force, actual.q, &state->upright, actual.q);
    }
    gimbal_inverse(gaze->attitude, wanted);
    gimbal_product(wanted, actual.q, off);
    gimbal_log(off, turn);
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
    for (int k = 0; k < 3; ++k) {
        out->w[k] = 0.0f;
        out->dw[k] = 0.0f;
        out->f[k] = 0.0f;
    }
    for (int tap = 0; tap < GIMBAL_TAPS; ++tap) {
        const float *past = state->past[(state->newest + tap) % GIMBAL_TAPS];
        for (int k = 0; k < 3; ++k) {
            out->w[k] += p->forecast[lead][0][tap] * past[k];
            out->dw[k] += p->forecast[lead][1][tap] * past[k];
            out->f[k] += p->forecast[lead][2][tap] * past[3 + k];
        }
    }
}

/* What was measured last, half a sample ago: a forecast that foresees nothing, of one gain and one phase. */
static void hold(const struct gimbal_parameters *p, const struct gimbal_holding *state, struct gimbal_ahead *out)
{
    const float *now = state->past[state->newest];
    const float *before = state->past[(state->newest + 1) % GIMBAL_TAPS];
    for (int k = 0; k < 3; ++k) {
        out->w[k] = 0.5f * (now[k] + before[k]);
        out->dw[k] = (now[k] - before[k]) / p->dt;
        out->f[k] = 0.5f * (now[3 + k] + before[3 + k]);
    }
}

/* Compare what was foreseen and what was held with what it came to; a forecast is trusted that errs less than none. */
static void judge(const struct gimbal_parameters *p, struct gimbal_holding *state, const struct gimbal_ahead *none,
                  const struct gimbal_ahead *last)
{
    bool better = true;
    for (int who = 0; who < 2; ++who) {
        float squares[4] = {0.0f, 0.0f, 0.0f, 0.0f};
        for (int k = 0; k < 6; ++k) {
            const float truth = k < 3 ? none->dw[k] : none->f[k - 3];
            const float error = state->due[0][who][k] - truth;
            float *slow = &state->slow_errors[who][k];
            *slow += p->judging.slow * (error - *slow);
            squares[k / 3] += error * error;
            squares[2 + k / 3] += *slow * *slow;
        }
        for (int i = 0; i < 4; ++i) {
            state->scores[who][i] += p->judging.mean * (squares[i] - state->scores[who][i]);
        }
    }
    for (int i = 0; i < 4; ++i) {
        better = better && state->scores[0][i] < state->scores[1][i];
    }
    state->trust = better ? fminf(1.0f, state->trust + p->judging.rise) : fmaxf(0.0f, state->trust - p->judging.fall);
    for (int k = 0; k < 6; ++k) {
        for (int i = 0; i + 1 < GIMBAL_DUE; ++i) {
            state->due[i][0][k] = state->due[i + 1][0][k];
            state->due[i][1][k] = state->due[i + 1][1][k];
        }
        state->due[GIMBAL_DUE - 1][0][k] = k < 3 ? last->dw[k] : last->f[k - 3];
        state->due[GIMBAL_DUE - 1][1][k] = k < 3 ? none->dw[k] : none->f[k - 3];
    }
}

/* A forecast as far as it is trusted. */
static void mix(float trust, const struct gimbal_ahead *none, struct gimbal_ahead *there)
{
    for (int k = 0; k < 3; ++k) {
        there->w[k] = none->w[k] + trust * (there->w[k] - none->w[k]);
        there->dw[k] = none->dw[k] + trust * (there->dw[k] - none->dw[k]);
        there->f[k] = none->f[k] + trust * (there->f[k] - none->f[k]);
    }
}

/* Rates and accelerations of the joints that turn the camera as it should on the base that moves so. */
static void wish(const struct view *view, const struct gaze *gaze, struct gimbal_ahead *there)
{
    float carried[3];
    float drift[3];
    gimbal_back(view->R, there->w, carried);
    for (int k = 0; k < 3; ++k) {
        carried[k] -= gaze->w[k];
    }
    undo(view, carried, there->v);
    gimbal_camera_drift(there->q, there->v, there->w, there->dw, drift);
    for (int k = 0; k < 3; ++k) {
        drift[k] -= gaze->dw[k];
    }
    undo(view, drift, there->a);
}

static void look_ahead(const struct gimbal_parameters *p, struct gimbal_holding *state,
                       const struct gimbal_sensors *seen, const struct view *first, struct fix *fix)
{
    struct gimbal_ahead none;
    hold(p, state, &none);
    for (int lead = 0; lead < GIMBAL_LEADS; ++lead) {
        foresee(p, state, lead, &fix->aim.ahead[lead]);
    }
    judge(p, state, &none, &fix->aim.ahead[GIMBAL_LEADS - 1]);
    for (int lead = 0; lead < GIMBAL_LEADS; ++lead) {
        struct gimbal_ahead *there = &fix->aim.ahead[lead];
        struct view view = *first;
        struct gaze gaze;
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            there->q[j] = seen->q[j] + p->holding_lead[lead] * fix->v[j];
        }
        if (p->holding_lead[lead] > p->holding_lead[0]) {
            look(&p->limits, there->q, &view);
        }
        mix(state->trust, &none, there);
        gaze_now(state, p->holding_lead[lead], &gaze);
        wish(&view, &gaze, there);
    }
}

/* --- One sample ---------------------------------------------------------------------------------------------------- */

/* From the sensors to where the joints are and should be. */
static void navigate(const struct gimbal_parameters *p, struct gimbal_holding *state,
                     const struct gimbal_sensors *seen, float elapsed, struct fix *fix)
{
    struct view view;
    struct gaze gaze;
    float q[GIMBAL_JOINTS];
    float carried[3];
    float turn[3];
    float rate[3];
    float error[GIMBAL_JOINTS];
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        q[j] = seen->q[j] + p->holding_lead[0] * state->v[j];
    }
    look(&p->limits, q, &view);
    fix->steep = view.steep;
    gimbal_back(view.R, seen->base_gyro, carried);
    gaze_now(state, 0.0f, &gaze);
    estimate(p, state, seen, elapsed, &gaze, turn, rate);
    undo(&view, turn, error);
    for (int k = 0; k < 3; ++k) {
        turn[k] = carried[k] - seen->camera_gyro[k];
        rate[k] += carried[k] - gaze.w[k];
    }
    undo(&view, turn, fix->v);
    undo(&view, rate, fix->aim.v);
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        fix->aim.q[j] = seen->q[j] + error[j];
        state->v[j] = fix->v[j];
    }
    if (p->law == GIMBAL_COMPUTED_TORQUE) {
        remember(state, seen);
        look_ahead(p, state, seen, &view, fix);
    }
}

/* What a lost camera gyro would say, by the base's gyro and the encoders' rates; without that the base stands. */
static void stand_in(const struct gimbal_holding *state, struct gimbal_sensors *seen)
{
    float R[9];
    float J[3 * GIMBAL_JOINTS];
    const float none[3] = {0.0f, 0.0f, 0.0f};
    gimbal_camera(seen->q, R, J);
    gimbal_back(R, gimbal_guard_lost(&state->guard, GIMBAL_BASE_GYRO) ? none : seen->base_gyro, seen->camera_gyro);
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            seen->camera_gyro[i] += J[i * GIMBAL_JOINTS + j] * state->guard.rates[j];
        }
    }
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
        gimbal_pid(p, loop, state->memory.integral, &error, y, tau);
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
    const struct gimbal_holding before = *state;
    gimbal_attitudes_now(last.q, &known);
    last.time_us += p->dt_us; /* of the sample to come, as a start is */
    gimbal_holding_start(p, state, &last, &known);
    state->time_us = before.time_us;
    state->upright = before.upright;
    begin_upright(&state->upright, before.upright.eased > 0.0f ? p->level_span * p->dt : 0.0f);
    state->refused = before.refused;
    state->distrusted = before.distrusted;
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
    float to[GIMBAL_GYROS][4];
    between(q, to);
    for (int k = 0; k < 4; ++k) {
        out->base[k] = k == 0 ? 1.0f : 0.0f;
        out->camera[k] = to[0][k];
        out->wanted[k] = to[0][k];
    }
    out->eased = 0.0f;
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
    float camera[4];
    float q[4];
    struct gimbal_attitude base;
    gimbal_guard_start(&p->limits, &state->guard, seen, p->dt_us);
    const struct gimbal_sensors *good = &state->guard.good;
    begin_law(&state->memory);
    relate(known->wanted, known, camera, q, state->upright.up);
    set_out(p, q, good->q, &state->way);
    if (state->way.obstacle != GIMBAL_NONE) {
        relate(known->camera, known, camera, q, state->upright.up);
        state->way.on = false;
    }
    begin_upright(&state->upright, known->eased);
    set(&state->attitude, camera);
    set(&base, q);
    begin(state, good, &base);
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        state->v[j] = 0.0f;
        state->tau[j] = 0.0f;
    }
    for (int k = 0; k < 3; ++k) {
        state->turning[k] = good->camera_gyro[k];
    }
    state->newest = 0;
    for (int tap = 0; tap < GIMBAL_TAPS; ++tap) {
        remember(state, good);
    }
    for (int who = 0; who < 2; ++who) {
        for (int k = 0; k < 6; ++k) {
            for (int i = 0; i < GIMBAL_DUE; ++i) {
                state->due[i][who][k] = k < 3 ? 0.0f : good->base_force[k - 3];
            }
            state->slow_errors[who][k] = 0.0f;
        }
        for (int i = 0; i < 4; ++i) {
            state->scores[who][i] = 0.0f;
        }
    }
    state->trust = 0.0f;
    state->apart = false;
    state->time_us = -(int64_t)p->dt_us;
    state->fallback = false;
    state->steep = false;
    state->limited = 0u;
    state->refused = 0u;
    state->unanswered = 0u;
    state->distrusted = 0u;
    state->lost = 0u;
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
