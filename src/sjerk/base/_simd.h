/* What the processor can be asked for beside the language, where it can be.
 *
 * WIDE: a function whose loops use wider vectors where the processor has them. The same operations in
 * the same order, no fused ones, so the same bits.
 */
#pragma once

/* Sanitizers start after the resolver of such a function runs. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__SANITIZE_ADDRESS__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif

/* Bring a line of memory into the caches, and its page's address; changes nothing. */
#if defined(__GNUC__)
#define FETCH(at) __builtin_prefetch(at)
#else
#define FETCH(at) ((void)(at))
#endif

enum { LINE = 64 };

static inline void fetch(const void *from, size_t bytes)
{
    const char *at = from;
    for (size_t i = 0; i < bytes; i += LINE)
        FETCH(at + i);
    FETCH(at + bytes - 1);
}
