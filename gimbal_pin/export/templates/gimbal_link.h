/*
 * Live tuning over a serial line or UDP: the gimbal streams its log and takes new gains and feed-forward.
 *
 * A frame is header, body and CRC, stuffed by COBS (Cheshire and Baker 1999), and a zero byte at its end; several may
 * stand in one datagram. All numbers are little-endian, floats IEEE 754 of 32 bits, units those of gimbal_controller.h.
 *
 *   header   uint8 version (1), uint8 type, uint16 sequence
 *   HELLO    nothing: a host asks for the log; send it again every second
 *   LOG      uint64 time_us, uint32 lost, float q[JOINTS], v[JOINTS], tau[JOINTS]
 *   TUNE     uint16 joints, uint16 others; {kp, ki, kd}[JOINTS] holding, the same tracking,
 *            constant[JOINTS], per_slide[JOINTS], per_rate[JOINTS], others[OTHERS]; uint64 count, uint64 tag
 *   ANSWER   uint16 sequence of the TUNE, uint16 status
 *   CRC      uint16 of header and body: polynomial 0x1021 from 0xffff (CCITT-FALSE)
 *
 * A TUNE's tag is SipHash-2-4 (Aumasson and Bernstein, INDOCRYPT 2012) of all before it, from the header on, under a
 * secret that host and gimbal share; its count is larger than that of every TUNE before. HELLO, LOG and ANSWER have no
 * tag: who hears the line reads the log.
 *
 * Call everything from one task. No byte is read beyond what came, nothing is allocated, and what is not a whole frame
 * of this version is dropped and counted.
 */
#ifndef GIMBAL_LINK_H
#define GIMBAL_LINK_H

#include <stddef.h>

#include "gimbal_controller.h"

enum {
    GIMBAL_LINK_VERSION = 1,
    GIMBAL_LINK_VALUES = 9 * GIMBAL_JOINTS + GIMBAL_OTHERS, /* floats of a TUNE */
    GIMBAL_LINK_SECRET = 16, /* bytes */
    GIMBAL_LINK_SEAL = 16,   /* count and tag of a TUNE */
    GIMBAL_LINK_TUNE = 4 + 4 * GIMBAL_LINK_VALUES + GIMBAL_LINK_SEAL,
    GIMBAL_LINK_LOG = 12 + 12 * GIMBAL_JOINTS,
    GIMBAL_LINK_BODY = GIMBAL_LINK_TUNE > GIMBAL_LINK_LOG ? GIMBAL_LINK_TUNE : GIMBAL_LINK_LOG,
    GIMBAL_LINK_PLAIN = GIMBAL_LINK_BODY + 6,                            /* with header and CRC */
    GIMBAL_LINK_FRAME = GIMBAL_LINK_PLAIN + GIMBAL_LINK_PLAIN / 254 + 2 /* with what COBS adds */
};

enum gimbal_link_type { GIMBAL_HELLO = 1, GIMBAL_LOG = 2, GIMBAL_TUNE = 3, GIMBAL_ANSWER = 4 };

enum gimbal_link_status {
    GIMBAL_TUNED,        /* in force since the last gimbal_link_apply */
    GIMBAL_OTHER_SIZE,   /* of a controller with other joints or terms */
    GIMBAL_OUT_OF_RANGE, /* see gimbal_link_receive */
    GIMBAL_NOT_SEALED,   /* with another secret than the gimbal's, or the gimbal has none */
    GIMBAL_STALE         /* its count is below that of an earlier TUNE */
};

struct gimbal_link {
    uint8_t frame[GIMBAL_LINK_FRAME]; /* what came since the last zero */
    size_t length;
    uint8_t secret[GIMBAL_LINK_SECRET]; /* all zero: none */
    uint64_t count;                   /* of the last TUNE with the right tag */
    float values[GIMBAL_LINK_VALUES]; /* of the last good TUNE */
    bool waiting;                     /* whether they are to be applied */
    bool answering;                   /* whether an ANSWER is due */
    bool greeted;                     /* whether a host has asked for the log */
    uint16_t asked;                   /* sequence of the last TUNE */
    uint16_t status;
    uint16_t sequence;                /* of the frames that go out */
    uint32_t dropped;                 /* frames that were none, or a TUNE of someone else, or an old one */
};

/* Begin. Secret: of this gimbal alone; NULL or all zero: no TUNE is taken. Count: link.count as it was stored before the
   last restart, so that a TUNE recorded then is not taken again; 0 where nothing was stored. */
void gimbal_link_start(struct gimbal_link *link, const uint8_t secret[GIMBAL_LINK_SECRET], uint64_t count);

/* SipHash-2-4: 64 bits of bytes under a key. */
uint64_t gimbal_link_tag(const uint8_t key[GIMBAL_LINK_SECRET], const uint8_t bytes[], size_t count);

/* Take bytes that came, any number. A TUNE is refused unless it bears the secret's tag and a new count; every value is a
   number; of every loop kp, kd > 0, 0 <= ki <= kp kd (Routh: else a double integrator under it is unstable) and
   kd T <= pi/2, T from the sample to the middle of the hold (an integrator with that delay is unstable beyond it); and
   every term is within the largest limit. What the gimbal's own parameters hold already passes. Returns whether one of
   the frames was good. */
bool gimbal_link_receive(struct gimbal_link *link, const struct gimbal_parameters *p, const uint8_t bytes[],
                         size_t count);

/* Between two steps: put what was taken into the parameters, all of it or nothing. Returns whether they changed. */
bool gimbal_link_apply(struct gimbal_link *link, struct gimbal_parameters *p);

/* Frames to send; return their length, which is 0 where no ANSWER is due. */
size_t gimbal_link_log(struct gimbal_link *link, uint64_t time_us, uint32_t lost, const float q[GIMBAL_JOINTS],
                       const float v[GIMBAL_JOINTS], const float tau[GIMBAL_JOINTS], uint8_t out[GIMBAL_LINK_FRAME]);
size_t gimbal_link_answer(struct gimbal_link *link, uint8_t out[GIMBAL_LINK_FRAME]);

#endif
