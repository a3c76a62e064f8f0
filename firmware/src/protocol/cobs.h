// Consistent overhead byte stuffing (Cheshire and Baker, IEEE/ACM Trans. Networking 7, 1999): no zero inside,
// so that a zero ends a frame and a lost byte costs that frame only. For fewer than 254 bytes it costs one
// byte.

#ifndef PROTOCOL_COBS_H
#define PROTOCOL_COBS_H

#include <stdint.h>

/// Stuffs `size` bytes (at most 253) into `out`, which needs size + 1 bytes. The closing zero is not written.
/// Returns the stuffed length, size + 1.
uint8_t cobs_stuff(const uint8_t *data, uint8_t size, uint8_t *out);

/// Undoes it in place. Returns the length, one less than `size`, or 0 when a code points past the end,
/// a zero is inside, or nothing is left.
uint8_t cobs_unstuff(uint8_t *data, uint8_t size);

#endif
