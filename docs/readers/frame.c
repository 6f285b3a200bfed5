/* Reads a rigcast frame, version 1 (docs/wire.md), from stdin and prints it; exit 1 where it is not one.
   Little-endian machines: cc -O2 -o frame frame.c */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#pragma pack(push, 1)
typedef struct {
    char magic[4];
    uint8_t version, state, clock, flags;
    uint32_t stream;
    uint16_t joints, samples;
    uint64_t seq, rig_hash;
    uint8_t report_id[8];
    uint64_t capture_ns, due_ns, period_ns;
} Header; /* 64 bytes */
#pragma pack(pop)

static uint32_t crc32(const uint8_t *data, size_t n) {
    uint32_t crc = 0xffffffff;
    while (n--) {
        crc ^= *data++;
        for (int k = 0; k < 8; k++) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320 : 0);
    }
    return ~crc;
}

/* The header where `data` (n bytes) is a whole frame, else NULL. The floats begin 64 bytes after it: positions and
   velocities [samples][joints], root [samples][7], with flag 1 torque limits [joints]; then contacts [samples]. */
const Header *frame(const uint8_t *data, size_t n) {
    const Header *h = (const Header *)data;
    uint32_t crc;
    if (n < 68 || memcmp(h->magic, "RIGF", 4) || h->version != 1 || h->flags > 1 || h->state > 3) return NULL;
    if (h->joints < 1 || h->joints > 128 || h->samples < 1 || h->samples > 256) return NULL;
    if (n != 68 + 4u * (h->samples * (2u * h->joints + 8) + h->flags * h->joints)) return NULL;
    memcpy(&crc, data + n - 4, 4);
    return crc == crc32(data, n - 4) ? h : NULL;
}

int main(void) {
    static uint8_t data[1 << 19];
    size_t n = fread(data, 1, sizeof data, stdin);
    const Header *h = frame(data, n);
    if (!h) return 1;
    const float *at = (const float *)(data + 64);
    const uint32_t *contacts = (const uint32_t *)(data + n - 4) - h->samples;
    printf("%u %llu %u %u %u\n", h->stream, (unsigned long long)h->seq, h->state, h->joints, h->samples);
    for (size_t k = 0; k < (n - 68) / 4 - h->samples; k++) printf("%.9g ", at[k]);
    for (size_t k = 0; k < h->samples; k++) printf("%u ", contacts[k]);
    return 0;
}
