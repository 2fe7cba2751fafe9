/* CRC-32 as in Ethernet, zlib and PNG: polynomial 0x04C11DB7, reflected (0xEDB88320), begins with all ones and is inverted
 * in the end. Of the nine characters "123456789" it is 0xCBF43926. */
#ifndef COGLESS_CRC32_H
#define COGLESS_CRC32_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* `crc`: 0, or that of the bytes before these. */
uint32_t cgl_crc32(uint32_t crc, const uint8_t *bytes, uint32_t count);

#ifdef __cplusplus
}
#endif

#endif
