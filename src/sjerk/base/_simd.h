/* What the processor can be asked for that the language does not have.
 *
 * SIMD: a function whose loops use wider vectors where the processor has them. The same operations in
 * the same order, no fused ones, so the same bits. SIMD_IS_WIDE: whether they are wider here than those
 * that every processor of the kind has; what computes both sides of a branch pays only then.
 */
#pragma once
#include <stddef.h> /* size_t */
#include <stdint.h> /* whose headers say what library it is: __GLIBC__ */

/* Sanitizers start after the resolver of such a function runs; what is written for wide vectors is to be seen by
 * them all the same. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__SANITIZE_ADDRESS__)
#define SIMD         __attribute__((target_clones("avx2", "default")))
#define SIMD_IS_WIDE __builtin_cpu_supports("avx2")
#elif defined(__SANITIZE_ADDRESS__)
#define SIMD
#define SIMD_IS_WIDE 1
#else
#define SIMD
#define SIMD_IS_WIDE 0
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
