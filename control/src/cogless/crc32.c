#include "crc32.h"

/* CRC remainder of each value of four bits. This table takes 64 bytes of flash. A table for eight bits would take 1024 bytes, and be twice
 * as fast. */
static const uint32_t nibble[16] = {0x00000000U, 0x1DB71064U, 0x3B6E20C8U, 0x26D930ACU, 0x76DC4190U, 0x6B6B51F4U,
                                    0x4DB26158U, 0x5005713CU, 0xEDB88320U, 0xF00F9344U, 0xD6D6A3E8U, 0xCB61B38CU,
                                    0x9B64C2B0U, 0x86D3D2D4U, 0xA00AE278U, 0xBDBDF21CU};

uint32_t cgl_crc32(uint32_t crc, const uint8_t *bytes, uint32_t count)
{
    uint32_t rest = ~crc;
    for (uint32_t n = 0; n < count; ++n) {
        rest ^= bytes[n];
        rest = (rest >> 4) ^ nibble[rest & 15U];
        rest = (rest >> 4) ^ nibble[rest & 15U];
    }
    return ~rest;
}
