#include "gimbal_law.h"

#include <math.h>

#include "gimbal_model.h"

/* The state of all joints at which the model's terms are evaluated. */
struct sample {
    float t; /* s */
    float q[GIMBAL_JOINTS];
    float v[GIMBAL_JOINTS];
    float a[GIMBAL_JOINTS];
    float slide[GIMBAL_JOINTS]; /* direction of sliding, -1 to 1 */
    float f[3];
    float w[3];
    float dw[3];
};

bool gimbal_finite(const float x[], int count)
{
    bool finite = true;
    for (int i = 0; i < count; ++i) {
        finite = finite && isfinite(x[i]);
    }
    return finite;
}

static float clipped(float x, float limit)
{
    return x < -limit ? -limit : x > limit ? limit : x;
}

static float length(const float x[], int count)
{
    float sum = 0.0f;
    for (int i = 0; i < count; ++i) {
        sum += x[i] * x[i];
    }
    return sqrtf(sum);
}

void gimbal_errors(float dt, const float q[GIMBAL_JOINTS], const float v[GIMBAL_JOINTS],
                   const float aim_q[GIMBAL_JOINTS], const float aim_v[GIMBAL_JOINTS],
                   const float integral[GIMBAL_JOINTS], struct gimbal_error *out)
{
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        out->angle[j] = aim_q[j] - q[j];
        out->rate[j] = aim_v[j] - v[j];
        out->integral[j] = integral[j] + dt * out->angle[j];
    }
}

/* Pull towards the goal: linear up to the knee, beyond it on the parabola of a constant deceleration. */
static float pull(const struct gimbal_loop *loop, float error)
{
    if (-loop->knee <= error && error <= loop->knee) {
        return loop->kp * error;
    }
    const float size = loop->kd * sqrtf(loop->braking * (2.0f * fabsf(error) - loop->knee));
    return error > 0.0f ? size : -size;
}

/* K xi of every joint, rad/s^2. */
static void feedback(const struct gimbal_loop loop[GIMBAL_JOINTS], const struct gimbal_error *error,
                     float out[GIMBAL_JOINTS])
{
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        out[j] = loop[j].ki * error->integral[j] + loop[j].kd * error->rate[j] + pull(&loop[j], error->angle[j]);
    }
}

/* Conditional integration: not while the error drives the motor further into its limit, nor on an approach. */
static void integrate(const struct gimbal_parameters *p, const struct gimbal_loop loop[GIMBAL_JOINTS],
                      const struct gimbal_error *error, const float wanted[GIMBAL_JOINTS],
                      float integral[GIMBAL_JOINTS])
{
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const bool further = fabsf(wanted[j]) > p->limit[j] && wanted[j] * error->angle[j] > 0.0f;
        const bool approaches = fabsf(error->angle[j]) > loop[j].knee;
        if (!further && !approaches) {
            integral[j] = error->integral[j];
        }
    }
}

/* Add the correction of Lyapunov redesign to the feedback, rad/s^2; wished: wanted accelerations. */
static void strengthen(const struct gimbal_robust *robust, const struct gimbal_error *error,
                       const float wished[GIMBAL_JOINTS], float y[GIMBAL_JOINTS])
{
    float z[GIMBAL_JOINTS];
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const float *row = robust->direction[j];
        z[j] = row[0] * error->integral[j] + row[1] * error->angle[j] + row[2] * error->rate[j];
    }
    const float asked = length(wished, GIMBAL_JOINTS) + length(y, GIMBAL_JOINTS);
    const float size = (robust->alpha * asked + robust->disturbance) / (1.0f - robust->alpha);
    const float away = length(z, GIMBAL_JOINTS);
    const float share = robust->gain * away <= size ? robust->gain : size / away;
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        y[j] += share * z[j];
    }
}

/* Friction that is affine in direction and rate, N m. */
static float friction(const struct gimbal_terms *terms, int j, float slide, float rate)
{
    return terms->constant[j] + terms->per_slide[j] * slide + terms->per_rate[j] * rate;
}

/* What all other terms add where the rest of the model asks for `rest` and `first` of it is known already, N m.
   Terms that feel the whole torque are iterated; one step of Aitken's method is exact where they are linear in it. */
static void add_terms(const struct gimbal_parameters *p, const struct sample *at, const float rest[GIMBAL_JOINTS],
                      const float weight[GIMBAL_JOINTS], const float known[GIMBAL_JOINTS], float tau[GIMBAL_JOINTS])
{
    float found[3][GIMBAL_JOINTS];
    const int passes = GIMBAL_LOADED ? 3 : 1;
    float load[GIMBAL_JOINTS];
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        load[j] = rest[j];
    }
    for (int pass = 0; pass < passes; ++pass) {
        gimbal_terms(p->terms.others, at->t, at->q, at->v, at->a, at->slide, load, weight, found[pass]);
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            found[pass][j] += known[j];
            load[j] = rest[j] + found[pass][j];
        }
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const float last = found[passes - 1][j];
        float more = 0.0f;
        if (passes == 3 && found[1][j] != found[0][j]) {
            const float slope = (last - found[1][j]) / (found[1][j] - found[0][j]);
            more = fabsf(slope) < 1.0f ? (last - found[1][j]) * slope / (1.0f - slope) : 0.0f;
        }
        tau[j] = rest[j] + last + more;
    }
}

/* What the rig asks for at rest, where a term reads it, N m. */
static void weigh(const struct sample *at, const float rigid[GIMBAL_JOINTS], float weight[GIMBAL_JOINTS])
{
    const float still[GIMBAL_JOINTS] = {0.0f};
    if (GIMBAL_WEIGHED) {
        gimbal_rigid_torque(at->q, still, still, at->f, at->w, at->dw, weight);
        return;
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        weight[j] = rigid[j];
    }
}

/* What to command so that a drive gives a torque, N m. */
static float commanded(const struct gimbal_drive *drive, float torque)
{
    if (drive->count < 2) {
        return torque;
    }
    const struct gimbal_point *points = &gimbal_drive_points[drive->first];
    int low = 0;
    int high = drive->count - 1;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (points[middle].torque <= torque) {
            low = middle;
        } else {
            high = middle;
        }
    }
    const float share = (torque - points[low].torque) / (points[high].torque - points[low].torque);
    return points[low].command + share * (points[high].command - points[low].command);
}

static void drive(const struct gimbal_parameters *p, float tau[GIMBAL_JOINTS])
{
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        tau[j] = commanded(&p->drive[j], tau[j]);
    }
}

/* --- Following a reference ---------------------------------------------------------------------------------------- */

void gimbal_tracking_start(struct gimbal_tracking *state)
{
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        state->integral[j] = 0.0f;
        state->acceleration[j] = 0.0f;
    }
    state->begun = false;
    state->refused = 0u;
}

/* Torque of the model at the measured state, with accelerations y and friction at the reference's rates, N m. */
static void invert(const struct gimbal_parameters *p, float t, const float q[], const float v[], const float y[],
                   const struct gimbal_reference *reference, float tau[])
{
    struct sample at = {.t = t, .f = {0.0f, 0.0f, p->gravity}};
    float rate[GIMBAL_JOINTS];
    float known[GIMBAL_JOINTS];
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const float lead = p->tracking_lead[j];
        at.q[j] = q[j] + lead * v[j];
        at.a[j] = y[j];
        rate[j] = reference->v[j] + lead * reference->a[j];
        at.v[j] = rate[j];
        at.slide[j] = -p->still < rate[j] && rate[j] < p->still ? 0.0f : (rate[j] > 0.0f ? 1.0f : -1.0f);
        known[j] = friction(&p->terms, j, at.slide[j], rate[j]);
    }
    float rigid[GIMBAL_JOINTS];
    float weight[GIMBAL_JOINTS];
    gimbal_rigid_torque(at.q, v, y, at.f, at.w, at.dw, rigid);
    weigh(&at, rigid, weight);
    add_terms(p, &at, rigid, weight, known, tau);
    drive(p, tau);
}

/* Computed torque that follows a reference, before it is cut to the limits. */
static void follow(const struct gimbal_parameters *p, const struct gimbal_tracking *state, float t, const float q[],
                   const float v[], const struct gimbal_reference *reference, const struct gimbal_error *error,
                   float wanted[])
{
    float ahead[GIMBAL_JOINTS];
    float y[GIMBAL_JOINTS];
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const float change = state->begun ? reference->a[j] - state->acceleration[j] : 0.0f;
        ahead[j] = reference->a[j] + p->tracking_lead[j] / p->dt * change;
    }
    feedback(p->tracking, error, y);
    if (p->robust.active) {
        strengthen(&p->robust, error, ahead, y);
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        y[j] += ahead[j];
    }
    invert(p, t, q, v, y, reference, wanted);
}

void gimbal_tracking_step(const struct gimbal_parameters *p, struct gimbal_tracking *state, float t,
                          const float q[GIMBAL_JOINTS], const float v[GIMBAL_JOINTS],
                          const struct gimbal_reference *reference, float tau[GIMBAL_JOINTS])
{
    struct gimbal_error error;
    gimbal_errors(p->dt, q, v, reference->q, reference->v, state->integral, &error);
    float wanted[GIMBAL_JOINTS];
    if (p->law == GIMBAL_PID) {
        gimbal_pid(p, p->tracking, state->integral, &error, wanted);
    } else {
        follow(p, state, t, q, v, reference, &error, wanted);
        integrate(p, p->tracking, &error, wanted, state->integral);
    }
    bool numbers = gimbal_finite(wanted, GIMBAL_JOINTS) && gimbal_finite(error.angle, GIMBAL_JOINTS) &&
                         gimbal_finite(error.rate, GIMBAL_JOINTS) && gimbal_finite(state->integral, GIMBAL_JOINTS) &&
                         gimbal_finite(reference->a, GIMBAL_JOINTS);
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        numbers = numbers && fabsf(q[j]) < p->limits.farthest && fabsf(v[j]) < p->limits.farthest;
    }
    if (!numbers) {
        const uint32_t refused = state->refused + 1u;
        gimbal_tracking_start(state);
        state->refused = refused;
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        tau[j] = numbers ? clipped(wanted[j], p->limit[j]) : 0.0f;
        state->acceleration[j] = numbers ? reference->a[j] : 0.0f;
    }
    state->begun = numbers;
}

void gimbal_pid(const struct gimbal_parameters *p, const struct gimbal_loop loop[GIMBAL_JOINTS],
                float integral[GIMBAL_JOINTS], const struct gimbal_error *error, float tau[GIMBAL_JOINTS])
{
    float y[GIMBAL_JOINTS];
    float wanted[GIMBAL_JOINTS];
    feedback(loop, error, y);
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        wanted[j] = loop[j].inertia * y[j];
        tau[j] = clipped(wanted[j], p->limit[j]);
    }
    integrate(p, loop, error, wanted, integral);
}

/* --- Holding the camera on a base that moves ---------------------------------------------------------------------- */

/* Mean of sign(rate) over a hold in whose middle the rate is `rate` and over half of which it changes by `change`. */
static float slide_share(float rate, float change)
{
    const float size = fabsf(change) > 0.0f ? fabsf(change) : 1e-9f;
    return rate > size ? 1.0f : rate < -size ? -1.0f : rate / size;
}

/* Torque of the model at one moment, with the feedback y added to the wanted accelerations, N m. */
static void feed_forward(const struct gimbal_parameters *p, float t, const struct gimbal_ahead *there,
                         const float y[GIMBAL_JOINTS], float tau[GIMBAL_JOINTS])
{
    struct sample at = {.t = t};
    float rest[GIMBAL_JOINTS];
    float weight[GIMBAL_JOINTS];
    const float nothing[GIMBAL_JOINTS] = {0.0f};
    for (int i = 0; i < 3; ++i) {
        at.f[i] = there->f[i];
        at.w[i] = there->w[i];
        at.dw[i] = there->dw[i];
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        at.q[j] = there->q[j];
        at.v[j] = there->v[j];
        at.a[j] = there->a[j] + y[j];
        at.slide[j] = slide_share(there->v[j], there->a[j] * 0.5f * p->dt);
    }
    gimbal_rigid_torque(at.q, at.v, at.a, at.f, at.w, at.dw, rest);
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        rest[j] += friction(&p->terms, j, at.slide[j], at.v[j]);
    }
    weigh(&at, rest, weight);
    add_terms(p, &at, rest, weight, nothing, tau);
    drive(p, tau);
}

void gimbal_hold(const struct gimbal_parameters *p, struct gimbal_memory *memory, float t,
                 const float q[GIMBAL_JOINTS], const float v[GIMBAL_JOINTS], const struct gimbal_aim *aim,
                 float tau[GIMBAL_JOINTS])
{
    struct gimbal_error error;
    float y[GIMBAL_JOINTS];
    float wanted[GIMBAL_JOINTS] = {0.0f};
    float moment[GIMBAL_JOINTS];
    gimbal_errors(p->dt, q, v, aim->q, aim->v, memory->integral, &error);
    feedback(p->holding, &error, y);
    if (p->robust.active) {
        strengthen(&p->robust, &error, aim->ahead[0].a, y);
    }
    for (int lead = 0; lead < GIMBAL_LEADS; ++lead) {
        feed_forward(p, t, &aim->ahead[lead], y, moment);
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            if (p->lead_of[j] == lead) {
                wanted[j] = moment[j] + p->lasting * memory->owed[j];
            }
        }
    }
    integrate(p, p->holding, &error, wanted, memory->integral);
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        tau[j] = clipped(wanted[j], p->limit[j]);
        memory->owed[j] = clipped(wanted[j] - tau[j], p->most_owed * p->limit[j]);
    }
}
