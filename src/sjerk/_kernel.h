/* The contract: every struct, enum and prototype that two rooms share.
 *
 * Read verbatim by the compiler and by cffi (API mode), so: no include guard, no #include, no #if,
 * no static inline, no expression in a #define; enums for constants. Each .c file includes
 * <stdint.h> and <stddef.h> before it. Padding is written out, offsets are asserted in the rooms.
 *
 * Units: the motion core is unit-free and counts time in cycles (velocity per cycle, acceleration
 * per cycle^2, jerk per cycle^3). A drive counts encoder increments. SI units carry a suffix (_s).
 */

/* ---- ground ---------------------------------------------------------------------------------- */

enum { SJ_AXES = 64 };                  /* most axes of one kernel */

/* ---- peers: handshake (_handshake.c) --------------------------------------------------------- */

/* ---- peers: drive (_cia402.c, _servo.c) ------------------------------------------------------ */

/* ---- wiring: interpolator and kernel cycle (_kernel.c) --------------------------------------- */

int32_t sj_max_axes(void);              /* SJ_AXES of the built extension */
