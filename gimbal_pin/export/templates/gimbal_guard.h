/* Checks every reading: finite, plausible, not frozen, in time; bridges what fails, and gives up what goes on failing. */
#ifndef GIMBAL_GUARD_H
#define GIMBAL_GUARD_H

#include "gimbal_controller.h"

/* Begin at the first sample: readings that fail there count as zero. */
void gimbal_guard_start(const struct gimbal_limits *limits, struct gimbal_guard *guard,
                        const struct gimbal_sensors *seen, uint32_t dt_us);

/* Check a sample; guard->good is then what may be used. Returns the time since the last one, microseconds.
   v: joint rates so far, by the gyros, rad/s; steep: whether that was near a singular pose. */
uint32_t gimbal_guard_step(const struct gimbal_limits *limits, struct gimbal_guard *guard,
                           const struct gimbal_sensors *seen, uint32_t dt_us, const float v[GIMBAL_JOINTS],
                           bool steep);

/* Whether nothing fails, nothing repeats and nothing is lost. */
bool gimbal_guard_calm(const struct gimbal_guard *guard);

/* Whether a channel is given up. */
bool gimbal_guard_lost(const struct gimbal_guard *guard, enum gimbal_channel channel);

/* Whether a channel is given up, or its last reading was not used. */
bool gimbal_guard_doubtful(const struct gimbal_guard *guard, enum gimbal_channel channel);

#endif
