#include "gimbal_link.h"

#include <string.h>

enum { HEADER = 4, CRC = 2 };

static uint16_t crc_of(const uint8_t bytes[], size_t count)
{
    uint32_t crc = 0xffffu;
    for (size_t i = 0; i < count; ++i) {
        crc ^= (uint32_t)bytes[i] << 8;
        for (int bit = 0; bit < 8; ++bit) {
            crc = (crc & 0x8000u) != 0u ? (crc << 1) ^ 0x1021u : crc << 1;
        }
        crc &= 0xffffu;
    }
    return (uint16_t)crc;
}

static void put(uint8_t *to, uint64_t value, size_t bytes)
{
    for (size_t i = 0; i < bytes; ++i) {
        to[i] = (uint8_t)(value >> (8u * i));
    }
}

static uint64_t get(const uint8_t *from, size_t bytes)
{
    uint64_t value = 0u;
    for (size_t i = 0; i < bytes; ++i) {
        value |= (uint64_t)from[i] << (8u * i);
    }
    return value;
}

static void put_floats(uint8_t *to, const float x[], size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        uint32_t bits;
        memcpy(&bits, &x[i], sizeof bits);
        put(&to[4u * i], bits, 4u);
    }
}

/* Header and CRC around a body that lies behind the header's place; then COBS and the zero. Returns the length. */
static size_t framed(struct gimbal_link *link, enum gimbal_link_type type, uint8_t plain[GIMBAL_LINK_PLAIN],
                     size_t body, uint8_t out[GIMBAL_LINK_FRAME])
{
    const size_t count = HEADER + body + CRC;
    size_t code = 0u; /* place of the count of the bytes up to the next zero */
    size_t at = 1u;
    plain[0] = GIMBAL_LINK_VERSION;
    plain[1] = (uint8_t)type;
    put(&plain[2], link->sequence, 2u);
    put(&plain[HEADER + body], crc_of(plain, HEADER + body), CRC);
    link->sequence = (uint16_t)(link->sequence + 1u);
    for (size_t i = 0; i < count; ++i) {
        if (at - code == 255u) {
            out[code] = 255u;
            code = at++;
        }
        if (plain[i] == 0u) {
            out[code] = (uint8_t)(at - code);
            code = at++;
        } else {
            out[at++] = plain[i];
        }
    }
    out[code] = (uint8_t)(at - code);
    out[at++] = 0u;
    return at;
}

/* Undo COBS in place; 0 where the frame is none. */
static size_t unstuffed(uint8_t frame[], size_t length)
{
    size_t from = 0u;
    size_t to = 0u;
    while (from < length) {
        const size_t run = frame[from];
        if (run == 0u || from + run > length) {
            return 0u;
        }
        for (size_t i = 1u; i < run; ++i) {
            frame[to++] = frame[from + i];
        }
        from += run;
        if (run < 255u && from < length) {
            frame[to++] = 0u;
        }
    }
    return to;
}

/* Whether the frame that ended is a HELLO. */
static bool understood(struct gimbal_link *link)
{
    uint8_t *frame = link->frame;
    const size_t length = link->length <= GIMBAL_LINK_FRAME ? unstuffed(frame, link->length) : 0u;
    return length >= HEADER + CRC && get(&frame[length - CRC], CRC) == crc_of(frame, length - CRC) &&
           frame[0] == GIMBAL_LINK_VERSION && frame[1] == GIMBAL_HELLO;
}

void gimbal_link_start(struct gimbal_link *link)
{
    memset(link, 0, sizeof *link);
}

bool gimbal_link_receive(struct gimbal_link *link, const uint8_t bytes[], size_t count)
{
    bool good = false;
    for (size_t i = 0; i < count; ++i) {
        if (bytes[i] != 0u) {
            if (link->length < GIMBAL_LINK_FRAME) {
                link->frame[link->length] = bytes[i];
            }
            link->length = link->length <= GIMBAL_LINK_FRAME ? link->length + 1u : link->length;
        } else if (link->length > 0u) {
            if (understood(link)) {
                good = true;
            } else {
                link->dropped += 1u;
            }
            link->length = 0u;
        }
    }
    link->greeted = link->greeted || good;
    return good;
}

size_t gimbal_link_log(struct gimbal_link *link, uint64_t time_us, uint32_t lost, const float q[GIMBAL_JOINTS],
                       const float v[GIMBAL_JOINTS], const float tau[GIMBAL_JOINTS], uint8_t out[GIMBAL_LINK_FRAME])
{
    uint8_t plain[GIMBAL_LINK_PLAIN];
    uint8_t *body = &plain[HEADER];
    put(body, time_us, 8u);
    put(&body[8], lost, 4u);
    put_floats(&body[12], q, GIMBAL_JOINTS);
    put_floats(&body[12 + 4 * GIMBAL_JOINTS], v, GIMBAL_JOINTS);
    put_floats(&body[12 + 8 * GIMBAL_JOINTS], tau, GIMBAL_JOINTS);
    return framed(link, GIMBAL_LOG, plain, GIMBAL_LINK_LOG, out);
}
