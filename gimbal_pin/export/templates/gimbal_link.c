#include "gimbal_link.h"

#include <math.h>
#include <string.h>

#include "gimbal_law.h"

enum { HEADER = 4, CRC = 2, TAG = 8 };

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

static uint64_t rotate_left(uint64_t word, unsigned bits)
{
    return (word << bits) | (word >> (64u - bits));
}

static void mix(uint64_t v[4], int rounds)
{
    for (; rounds > 0; --rounds) {
        v[0] += v[1];
        v[2] += v[3];
        v[1] = rotate_left(v[1], 13u) ^ v[0];
        v[3] = rotate_left(v[3], 16u) ^ v[2];
        v[0] = rotate_left(v[0], 32u) + v[3];
        v[2] += v[1];
        v[1] = rotate_left(v[1], 17u) ^ v[2];
        v[3] = rotate_left(v[3], 21u) ^ v[0];
        v[2] = rotate_left(v[2], 32u);
    }
}

uint64_t gimbal_link_tag(const uint8_t key[GIMBAL_LINK_SECRET], const uint8_t bytes[], size_t count)
{
    const uint64_t low = get(key, 8u);
    const uint64_t high = get(&key[8], 8u);
    uint64_t v[4] = {low ^ 0x736f6d6570736575u, high ^ 0x646f72616e646f6du, low ^ 0x6c7967656e657261u,
                     high ^ 0x7465646279746573u};
    for (size_t at = 0u; at <= count; at += 8u) {
        const size_t left = count - at;
        const uint64_t word = left < 8u ? get(&bytes[at], left) | (uint64_t)count << 56u : get(&bytes[at], 8u);
        v[3] ^= word;
        mix(v, 2);
        v[0] ^= word;
    }
    v[2] ^= 0xffu;
    mix(v, 4);
    return v[0] ^ v[1] ^ v[2] ^ v[3];
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

/* Gains that hold a double integrator, `late` seconds late; those in force pass. */
static bool steady(const float gains[3], const struct gimbal_loop *own, float late)
{
    const float half_pi = 1.57079633f;
    const bool same = !(fabsf(gains[0] - own->kp) > 0.0f || fabsf(gains[1] - own->ki) > 0.0f ||
                        fabsf(gains[2] - own->kd) > 0.0f);
    return same || (gains[0] > 0.0f && gains[1] >= 0.0f && gains[2] > 0.0f && gains[1] <= gains[0] * gains[2] &&
                    gains[2] * late <= half_pi);
}

/* Whether a TUNE's values may be applied. */
static bool sound(const struct gimbal_parameters *p, const float values[GIMBAL_LINK_VALUES])
{
    float most = 0.0f;
    if (!gimbal_finite(values, GIMBAL_LINK_VALUES)) {
        return false;
    }
    for (int j = 0; j < GIMBAL_JOINTS; ++j) {
        const float late = p->holding_lead[p->lead_of[j]];
        most = fmaxf(most, p->limit[j]);
        if (!steady(&values[3 * j], &p->holding[j], late) ||
            !steady(&values[3 * (GIMBAL_JOINTS + j)], &p->tracking[j], late)) {
            return false;
        }
    }
    for (int i = 6 * GIMBAL_JOINTS; i < GIMBAL_LINK_VALUES; ++i) {
        if (fabsf(values[i]) > most) {
            return false;
        }
    }
    return true;
}

static void take(struct gimbal_link *link, const struct gimbal_parameters *p, const uint8_t *body, size_t count)
{
    float values[GIMBAL_LINK_VALUES];
    link->status = GIMBAL_OTHER_SIZE;
    if (count != GIMBAL_LINK_TUNE || get(body, 2u) != GIMBAL_JOINTS || get(&body[2], 2u) != GIMBAL_OTHERS) {
        return;
    }
    for (size_t i = 0; i < GIMBAL_LINK_VALUES; ++i) {
        const uint32_t bits = (uint32_t)get(&body[4u + 4u * i], 4u);
        memcpy(&values[i], &bits, sizeof bits);
    }
    link->status = GIMBAL_OUT_OF_RANGE;
    if (sound(p, values)) {
        memcpy(link->values, values, sizeof values);
        link->waiting = true;
        link->status = GIMBAL_TUNED;
    }
}

/* Whether a TUNE, without its CRC, bears the tag of the gimbal's secret. */
static bool is_sealed(const struct gimbal_link *link, const uint8_t *frame, size_t length)
{
    unsigned any = 0u;
    for (size_t i = 0; i < GIMBAL_LINK_SECRET; ++i) {
        any |= link->secret[i];
    }
    return any != 0u && length >= HEADER + GIMBAL_LINK_SEAL &&
           get(&frame[length - TAG], TAG) == gimbal_link_tag(link->secret, frame, length - TAG);
}

/* Look at a TUNE, without its CRC; whether it is of who has the secret, and new. What comes twice is answered once. */
static bool take_sealed(struct gimbal_link *link, const struct gimbal_parameters *p, const uint8_t *frame,
                        size_t length)
{
    const bool ours = is_sealed(link, frame, length);
    const uint64_t count = ours ? get(&frame[length - GIMBAL_LINK_SEAL], 8u) : 0u;
    if (ours && count == link->count) {
        return false;
    }
    link->asked = (uint16_t)get(&frame[2], 2u);
    link->answering = true;
    link->status = ours ? GIMBAL_STALE : GIMBAL_NOT_SEALED;
    if (count <= link->count) {
        return false;
    }
    link->count = count;
    take(link, p, &frame[HEADER], length - HEADER);
    return true;
}

/* Look at one frame; whether it was good. */
static bool understood(struct gimbal_link *link, const struct gimbal_parameters *p)
{
    uint8_t *frame = link->frame;
    const size_t length = link->length <= GIMBAL_LINK_FRAME ? unstuffed(frame, link->length) : 0u;
    if (length < HEADER + CRC || get(&frame[length - CRC], CRC) != crc_of(frame, length - CRC) ||
        frame[0] != GIMBAL_LINK_VERSION) {
        return false;
    }
    if (frame[1] == GIMBAL_TUNE) {
        return take_sealed(link, p, frame, length - CRC);
    }
    link->greeted = link->greeted || frame[1] == GIMBAL_HELLO;
    return frame[1] == GIMBAL_HELLO;
}

void gimbal_link_start(struct gimbal_link *link, const uint8_t secret[GIMBAL_LINK_SECRET], uint64_t count)
{
    memset(link, 0, sizeof *link);
    if (secret != NULL) {
        memcpy(link->secret, secret, GIMBAL_LINK_SECRET);
    }
    link->count = count;
}

bool gimbal_link_receive(struct gimbal_link *link, const struct gimbal_parameters *p, const uint8_t bytes[],
                         size_t count)
{
    bool good = false;
    for (size_t i = 0; i < count; ++i) {
        if (bytes[i] != 0u) {
            if (link->length < GIMBAL_LINK_FRAME) {
                link->frame[link->length] = bytes[i];
            }
            link->length = link->length <= GIMBAL_LINK_FRAME ? link->length + 1u : link->length;
        } else if (link->length > 0u) {
            if (understood(link, p)) {
                good = true;
            } else {
                link->dropped += 1u;
            }
            link->length = 0u;
        }
    }
    return good;
}

bool gimbal_link_apply(struct gimbal_link *link, struct gimbal_parameters *p)
{
    const float *value = link->values;
    struct gimbal_loop *loops[2] = {p->holding, p->tracking};
    if (!link->waiting) {
        return false;
    }
    for (int which = 0; which < 2; ++which) {
        for (int j = 0; j < GIMBAL_JOINTS; ++j) {
            struct gimbal_loop *loop = &loops[which][j];
            loop->kp = *value++;
            loop->ki = *value++;
            loop->kd = *value++;
            loop->knee = loop->braking * (loop->kd / loop->kp) * (loop->kd / loop->kp);
        }
    }
    memcpy(p->terms.constant, value, sizeof p->terms.constant);
    memcpy(p->terms.per_slide, &value[GIMBAL_JOINTS], sizeof p->terms.per_slide);
    memcpy(p->terms.per_rate, &value[2 * GIMBAL_JOINTS], sizeof p->terms.per_rate);
    memcpy(p->terms.others, &value[3 * GIMBAL_JOINTS], sizeof p->terms.others);
    link->waiting = false;
    return true;
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

size_t gimbal_link_answer(struct gimbal_link *link, uint8_t out[GIMBAL_LINK_FRAME])
{
    uint8_t plain[GIMBAL_LINK_PLAIN];
    if (!link->answering || link->waiting) {
        return 0u;
    }
    link->answering = false;
    put(&plain[HEADER], link->asked, 2u);
    put(&plain[HEADER + 2], link->status, 2u);
    return framed(link, GIMBAL_ANSWER, plain, 4u, out);
}
