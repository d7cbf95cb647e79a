/*
 * Telemetry over a serial line or UDP: the gimbal streams its log to a host that asks for it.
 *
 * A frame is header, body and CRC, stuffed by COBS (Cheshire and Baker 1999), and a zero byte at its end; several may
 * stand in one datagram. All numbers are little-endian, floats IEEE 754 of 32 bits, units those of gimbal_controller.h.
 *
 *   header   uint8 version (1), uint8 type, uint16 sequence
 *   HELLO    nothing: a host asks for the log; send it again every second
 *   LOG      uint64 time_us, uint32 lost, float q[JOINTS], v[JOINTS], tau[JOINTS]
 *   CRC      uint16 of header and body: polynomial 0x1021 from 0xffff (CCITT-FALSE)
 *
 * A host can ask for the log and change nothing. Nothing is encrypted: whoever reads the line reads the log.
 *
 * Call everything from one task. No byte is read beyond what came, nothing is allocated, and what is not a HELLO of this
 * version is dropped and counted.
 */
#ifndef GIMBAL_LINK_H
#define GIMBAL_LINK_H

#include <stddef.h>

#include "gimbal_controller.h"

enum {
    GIMBAL_LINK_VERSION = 1,
    GIMBAL_LINK_LOG = 12 + 12 * GIMBAL_JOINTS,
    GIMBAL_LINK_PLAIN = GIMBAL_LINK_LOG + 6,                             /* with header and CRC */
    GIMBAL_LINK_FRAME = GIMBAL_LINK_PLAIN + GIMBAL_LINK_PLAIN / 254 + 2 /* with what COBS adds */
};

enum gimbal_link_type { GIMBAL_HELLO = 1, GIMBAL_LOG = 2 };

struct gimbal_link {
    uint8_t frame[GIMBAL_LINK_FRAME]; /* bytes since the last zero */
    size_t length;
    bool greeted;                     /* whether a host has asked for the log */
    uint16_t sequence;                /* of the frames that go out */
    uint32_t dropped;                 /* frames that were no HELLO */
};

void gimbal_link_start(struct gimbal_link *link);

/* Take bytes that came, any number. Returns whether one of the frames was a HELLO. */
bool gimbal_link_receive(struct gimbal_link *link, const uint8_t bytes[], size_t count);

/* A sample's frame to send; returns its length. */
size_t gimbal_link_log(struct gimbal_link *link, uint64_t time_us, uint32_t lost, const float q[GIMBAL_JOINTS],
                       const float v[GIMBAL_JOINTS], const float tau[GIMBAL_JOINTS], uint8_t out[GIMBAL_LINK_FRAME]);

#endif
