#include "gimbal_guard.h"

#include <math.h>
#include <string.h>

/* Counters stop here: none is compared with so much. */
static const int MANY = 10000;

/* A channel's values in a sample, and how many there are. */
static float *values(struct gimbal_sensors *seen, enum gimbal_channel channel, int *count)
{
    *count = 3;
    switch (channel) {
    case GIMBAL_CAMERA_GYRO:
        return seen->camera_gyro;
    case GIMBAL_BASE_GYRO:
        return seen->base_gyro;
    case GIMBAL_BASE_FORCE:
        return seen->base_force;
    case GIMBAL_LINK_GYROS:
        *count = 3 * (GIMBAL_GYROS - 1);
        return seen->link_gyro[0];
    default:
        *count = GIMBAL_JOINTS;
        return seen->q;
    }
}

static bool plausible(const struct gimbal_limits *limits, const float x[], int count, enum gimbal_channel channel)
{
    const float most = channel == GIMBAL_ENCODERS     ? limits->farthest
                       : channel == GIMBAL_BASE_FORCE ? limits->strongest
                                                      : limits->fastest;
    for (int i = 0; i < count; ++i) {
        if (!(fabsf(x[i]) < most)) { /* nor is what is no number */
            return false;
        }
    }
    return true;
}

void gimbal_guard_start(const struct gimbal_limits *limits, struct gimbal_guard *guard,
                        const struct gimbal_sensors *seen, uint32_t dt_us)
{
    memset(guard, 0, sizeof *guard);
    guard->raw = *seen;
    guard->raw.time_us = seen->time_us - dt_us;
    guard->good = guard->raw;
    for (int channel = 0; channel < GIMBAL_CHANNELS; ++channel) {
        int count;
        float *x = values(&guard->good, (enum gimbal_channel)channel, &count);
        const bool fine = plausible(limits, x, count, (enum gimbal_channel)channel);
        for (int i = 0; i < count && !fine; ++i) {
            x[i] = 0.0f;
        }
        guard->healthy[channel] = -1;
        guard->swings[channel] = limits->first * limits->least[channel];
    }
    guard->before = guard->good;
}

bool gimbal_guard_lost(const struct gimbal_guard *guard, enum gimbal_channel channel)
{
    return guard->healthy[channel] >= 0;
}

bool gimbal_guard_doubtful(const struct gimbal_guard *guard, enum gimbal_channel channel)
{
    return guard->healthy[channel] >= 0 || guard->failing[channel] > 0;
}

bool gimbal_guard_calm(const struct gimbal_guard *guard)
{
    for (int channel = 0; channel < GIMBAL_CHANNELS; ++channel) {
        if (guard->failing[channel] || guard->repeating[channel] || guard->healthy[channel] >= 0) {
            return false;
        }
    }
    return true;
}

/* Time since the last sample on an even clock: a gap is real, a jump is the clock's. */
static uint32_t timed(const struct gimbal_limits *limits, uint32_t stamp, uint32_t before, uint32_t dt_us)
{
    const uint32_t elapsed = stamp - before; /* wraps around as the stamp does */
    const bool even = elapsed > 0u && (float)elapsed <= 1e6f * limits->longest;
    return even ? elapsed : dt_us;
}

/* Whether three readings in a row of a channel are all as before: one sensor of several is enough. */
static bool frozen(const float now[], const float old[], int count)
{
    for (int i = 0; i < count; i += 3) {
        if (now[i] == old[i] && now[i + 1] == old[i + 1] && now[i + 2] == old[i + 2]) {
            return true;
        }
    }
    return false;
}

static bool encoders_fine(const struct gimbal_limits *limits, const struct gimbal_guard *guard,
                          const float moved[GIMBAL_JOINTS])
{
    if (guard->failing[GIMBAL_CAMERA_GYRO] || guard->failing[GIMBAL_BASE_GYRO]) {
        return true; /* there are no gyros to compare them with */
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        if (!(fabsf(moved[j]) < limits->moved)) {
            return false;
        }
    }
    return true;
}

/* What stands in for angles that fail: the last ones and what the gyros say since. */
static void bridged(struct gimbal_guard *guard, const float last[], const float moved[], float elapsed,
                    const float v[], float out[])
{
    const bool first = guard->failing[GIMBAL_ENCODERS] == 1;
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        out[j] = last[j] + (first && moved[j] != 0.0f ? moved[j] : elapsed * v[j]);
    }
}

static int more(int count)
{
    return count < MANY ? count + 1 : count;
}

/* For how long a channel that was given up has been good; -1: it is believed. */
static int judged(const struct gimbal_limits *limits, int failing, int healthy)
{
    if (healthy < 0) {
        return failing > limits->held ? 0 : -1;
    }
    if (failing > 0) {
        return 0;
    }
    return healthy + 1 >= limits->back ? -1 : healthy + 1;
}

/* Change of a channel from a sample to another. */
static float changed(struct gimbal_sensors *from, struct gimbal_sensors *to, enum gimbal_channel channel)
{
    int count;
    const float *x = values(to, channel, &count);
    const float *last = values(from, channel, &count);
    float sum = 0.0f;
    for (int i = 0; i < count; ++i) {
        sum += (x[i] - last[i]) * (x[i] - last[i]);
    }
    return sqrtf(sum);
}

/* Whether a change is a spike: far larger than any of late. */
static bool spikes(const struct gimbal_limits *limits, const struct gimbal_guard *guard, enum gimbal_channel channel,
                   float change)
{
    return !(change <= fmaxf(limits->times * guard->swings[channel], limits->least[channel]));
}

/* Look at one channel by itself, and put in what may be used of it; late: samples are missing before. Whether its change
   is no spike. */
static bool sift(const struct gimbal_limits *limits, struct gimbal_guard *guard, struct gimbal_sensors *good,
                 enum gimbal_channel channel, float elapsed, bool late, const float v[])
{
    int count;
    float *x = values(good, channel, &count);
    const float *last = values(&guard->good, channel, &count);
    const float *raw = values(&guard->raw, channel, &count);
    float change = late ? 0.0f : changed(&guard->good, good, channel);
    const float back = late ? 0.0f : changed(&guard->before, good, channel);
    const bool steady = !spikes(limits, guard, channel, change);
    if (!steady && !spikes(limits, guard, channel, back)) {
        change = back; /* a wrong reading went through before: this is its end */
    }
    bool fine = plausible(limits, x, count, channel) &&
                (guard->failing[channel] > 0 || !spikes(limits, guard, channel, change));
    if (channel == GIMBAL_ENCODERS) {
        fine = fine && encoders_fine(limits, guard, guard->moved);
    } else if (limits->noisy) {
        guard->repeating[channel] = fine && frozen(x, raw, count) ? more(guard->repeating[channel]) : 0;
        fine = fine && guard->repeating[channel] < limits->repeats;
    }
    guard->failing[channel] = fine ? 0 : more(guard->failing[channel]);
    if (!fine && channel == GIMBAL_ENCODERS) {
        bridged(guard, last, guard->moved, elapsed, v, x);
    } else if (!fine) {
        for (int i = 0; i < count; ++i) {
            x[i] = last[i];
        }
    }
    guard->healthy[channel] = judged(limits, guard->failing[channel], guard->healthy[channel]);
    guard->swings[channel] = fmaxf(limits->kept * guard->swings[channel], fine ? change : 0.0f);
    return steady;
}

/* Joint rates from the encoders. */
static void smooth(const struct gimbal_limits *limits, const float now[], const float before[], float elapsed,
                   float rates[])
{
    const float share = fminf(1.0f, elapsed / limits->smoothing);
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        rates[j] += share * ((now[j] - before[j]) / elapsed - rates[j]);
    }
}

uint32_t gimbal_guard_step(const struct gimbal_limits *limits, struct gimbal_guard *guard,
                           const struct gimbal_sensors *seen, uint32_t dt_us, const float v[GIMBAL_JOINTS],
                           bool steep)
{
    const uint32_t elapsed_us = timed(limits, seen->time_us, guard->raw.time_us, dt_us);
    const float elapsed = 1e-6f * (float)elapsed_us;
    const bool late = (float)elapsed_us > 1.5f * (float)dt_us;
    struct gimbal_sensors good = *seen;
    const bool calm = gimbal_guard_calm(guard);
    bool steady = true;
    bool all = true;
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        all = all && seen->q[j] == guard->raw.q[j];
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const bool stands = steep ? all : seen->q[j] == guard->raw.q[j];
        guard->moved[j] = stands ? guard->moved[j] + elapsed * v[j] : 0.0f;
    }
    for (int channel = 0; channel < GIMBAL_CHANNELS; ++channel) {
        steady = sift(limits, guard, &good, (enum gimbal_channel)channel, elapsed, late, v) && steady;
    }
    if (calm && steady && gimbal_guard_calm(guard)) {
        memcpy(guard->rates, v, sizeof guard->rates);
    } else {
        smooth(limits, good.q, guard->good.q, elapsed, guard->rates);
    }
    guard->raw = *seen;
    guard->before = guard->good;
    guard->good = good;
    return elapsed_us;
}
