/*
 * Messages with a checksum, for C and C++; tests/c_and_cpp/exchange.rs has the same in Rust.
 *
 * Message n has 16 + (n * 2654435761 mod 2^32) mod 3000 bytes: its number, the FNV-1a hash of all
 * later bytes, and bytes that depend on the number.
 */
#ifndef CHECKED_H
#define CHECKED_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define CHECKED_LONGEST 3016

static inline size_t checked_size(uint64_t n) {
    return 16 + (uint32_t)((uint32_t)n * 2654435761u) % 3000;
}

static inline uint64_t checked_hash(const unsigned char *bytes, size_t size) {
    uint64_t hash = UINT64_C(0xcbf29ce484222325);
    for (size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * UINT64_C(0x100000001b3);
    return hash;
}

static inline size_t checked_fill(unsigned char *to, uint64_t n) {
    const size_t size = checked_size(n);
    for (size_t i = 16; i < size; ++i) to[i] = (unsigned char)(n * 31 + i * 7);
    const uint64_t hash = checked_hash(to + 16, size - 16);
    memcpy(to, &n, 8);
    memcpy(to + 8, &hash, 8);
    return size;
}

/* Returns 1 if the message is complete, and sets *n to its number. */
static inline int checked_is_whole(const void *data, size_t size, uint64_t *n) {
    const unsigned char *bytes = (const unsigned char *)data;
    uint64_t hash;
    if (size < 16) return 0;
    memcpy(n, bytes, 8);
    memcpy(&hash, bytes + 8, 8);
    return size == checked_size(*n) && hash == checked_hash(bytes + 16, size - 16);
}

#endif
