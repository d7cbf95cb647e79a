#include "gimbal_guard.h"

#include <math.h>

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
        guard->failing[channel] = 0;
        guard->repeating[channel] = 0;
        guard->healthy[channel] = -1;
        guard->swings[channel] = limits->first * limits->least[channel];
    }
    guard->before = guard->good;
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        guard->moved[j] = 0.0f;
        guard->rates[j] = 0.0f;
    }
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

static float square(const float x[], int count)
{
    float sum = 0.0f;
    for (int i = 0; i < count; ++i) {
        sum += x[i] * x[i];
    }
    return sum;
}

/* Whether any gyro or accelerometer begins with the reading that it had before. */
static bool repeats(const struct gimbal_sensors *seen, const struct gimbal_sensors *before)
{
    bool same = seen->camera_gyro[0] == before->camera_gyro[0] || seen->base_gyro[0] == before->base_gyro[0] ||
                seen->base_force[0] == before->base_force[0];
    for (int i = 0; i < GIMBAL_GYROS - 1; ++i) {
        same = same || seen->link_gyro[i][0] == before->link_gyro[i][0];
    }
    return same;
}

/* Whether all readings are plausible, none is frozen and none repeats. Sizes are looked at, which is stricter. */
static bool sound(const struct gimbal_limits *limits, const struct gimbal_sensors *seen,
                  const struct gimbal_sensors *before, const float moved[GIMBAL_JOINTS])
{
    const float turning = square(seen->camera_gyro, 3) + square(seen->base_gyro, 3) +
                          square(seen->link_gyro[0], 3 * (GIMBAL_GYROS - 1));
    const bool slow = turning < limits->fastest * limits->fastest;
    const bool moves = square(moved, GIMBAL_JOINTS) < limits->moved * limits->moved;
    const bool near = square(seen->q, GIMBAL_JOINTS) < limits->farthest * limits->farthest;
    const bool weak = square(seen->base_force, 3) < limits->strongest * limits->strongest;
    return slow && moves && near && weak && !(limits->noisy && repeats(seen, before));
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
static float changed(const struct gimbal_sensors *from, const struct gimbal_sensors *to, enum gimbal_channel channel)
{
    struct gimbal_sensors now = *to;
    struct gimbal_sensors then = *from;
    int count;
    const float *x = values(&now, channel, &count);
    const float *last = values(&then, channel, &count);
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

/* Look at one channel by itself, and put in what may be used of it. */
static void sift(const struct gimbal_limits *limits, struct gimbal_guard *guard, struct gimbal_sensors *good,
                 enum gimbal_channel channel, float elapsed, const float v[], const float moved[], float *change)
{
    int count;
    float *x = values(good, channel, &count);
    const float *last = values(&guard->good, channel, &count);
    const float *raw = values(&guard->raw, channel, &count);
    bool fine = plausible(limits, x, count, channel) &&
                (guard->failing[channel] > 0 || !spikes(limits, guard, channel, *change));
    if (channel == GIMBAL_ENCODERS) {
        fine = fine && encoders_fine(limits, guard, moved);
    } else if (limits->noisy) {
        guard->repeating[channel] = fine && frozen(x, raw, count) ? more(guard->repeating[channel]) : 0;
        fine = fine && guard->repeating[channel] < limits->repeats;
    }
    guard->failing[channel] = fine ? 0 : more(guard->failing[channel]);
    *change = fine ? *change : 0.0f;
    if (!fine && channel == GIMBAL_ENCODERS) {
        bridged(guard, last, moved, elapsed, v, x);
    } else if (!fine) {
        for (int i = 0; i < count; ++i) {
            x[i] = last[i];
        }
    }
    guard->healthy[channel] = judged(limits, guard->failing[channel], guard->healthy[channel]);
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
    float changes[GIMBAL_CHANNELS];
    bool steady = true;
    bool all = true;
    for (int channel = 0; channel < GIMBAL_CHANNELS; ++channel) {
        changes[channel] = late ? 0.0f : changed(&guard->good, seen, (enum gimbal_channel)channel);
        steady = steady && !spikes(limits, guard, (enum gimbal_channel)channel, changes[channel]);
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        all = all && seen->q[j] == guard->raw.q[j];
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const bool stands = steep ? all : seen->q[j] == guard->raw.q[j];
        guard->moved[j] = stands ? guard->moved[j] + elapsed * v[j] : 0.0f;
    }
    if (gimbal_guard_calm(guard) && steady && sound(limits, seen, &guard->raw, guard->moved)) {
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            guard->rates[j] = v[j];
        }
    } else {
        for (int channel = 0; channel < GIMBAL_CHANNELS; ++channel) {
            const float back = late ? 0.0f : changed(&guard->before, seen, (enum gimbal_channel)channel);
            if (spikes(limits, guard, (enum gimbal_channel)channel, changes[channel]) &&
                !spikes(limits, guard, (enum gimbal_channel)channel, back)) {
                changes[channel] = back; /* a wrong reading went through before: this is its end */
            }
            sift(limits, guard, &good, (enum gimbal_channel)channel, elapsed, v, guard->moved, &changes[channel]);
        }
        smooth(limits, good.q, guard->good.q, elapsed, guard->rates);
    }
    for (int channel = 0; channel < GIMBAL_CHANNELS; ++channel) {
        guard->swings[channel] = fmaxf(limits->kept * guard->swings[channel], changes[channel]);
    }
    guard->raw = *seen;
    guard->before = guard->good;
    guard->good = good;
    return elapsed_us;
}
