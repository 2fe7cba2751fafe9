/* CRC-32 as in Ethernet, zlib and PNG. The polynomial is 0x04C11DB7, reflected 0xEDB88320. The CRC starts with all ones and is inverted
 * at the end. The nine characters "123456789" have the CRC 0xCBF43926. */
#ifndef COGLESS_CRC32_H
#define COGLESS_CRC32_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Returns the CRC of the bytes. `crc` is 0, or the CRC of the bytes that precede them. */
uint32_t cgl_crc32(uint32_t crc, const uint8_t *bytes, uint32_t count);

#ifdef __cplusplus
}
#endif

#endif
