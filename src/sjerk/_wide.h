/* WIDE: a function whose loops use wider vectors where the processor has them. The same operations in
 * the same order, no fused ones, so the same bits.
 */
#ifndef SJ_WIDE_H
#define SJ_WIDE_H

/* Sanitizers start after the resolver of such a function runs. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__SANITIZE_ADDRESS__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif

#endif
