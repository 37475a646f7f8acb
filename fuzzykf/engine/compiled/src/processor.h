/* The kinds of processors that the arithmetic is compiled for, the fastest last. */
#ifndef FUZZYKF_PROCESSOR_H
#define FUZZYKF_PROCESSOR_H

/* GCC on Windows does not align the stack as the wide vectors need it (its bug 54412); Clang does. */
#if defined(__x86_64__) && (defined(__clang__) || (defined(__GNUC__) && !defined(_WIN32)))
#define FK_X86 1
/* Beside versions for what nearly every processor of the kind can do, the portable one need not be fast: its
 * sizes share their code.  Elsewhere it is the only one. */
#define FK_PORTABLE_IS_SIZED 0
#else
#define FK_PORTABLE_IS_SIZED 1
#endif

/* The size by which code of its own is chosen; 0 where there is none. */
#define FK_OWN_SIZE(size) (FK_IS_SIZED ? (size) : 0)

#if defined(FK_X86) && defined(_MSC_VER) /* clang-cl: __builtin_cpu_supports asks for a library of Clang */
#include <cpuid.h>

static inline int fk_levels(void) {
  unsigned a, b, c, d, low, high;
  if (!__get_cpuid(1, &a, &b, &c, &d)) return 1;
  if (!(c & 1u << 12) || !(c & 1u << 27) || !(c & 1u << 28)) return 1; /* FMA, OSXSAVE, AVX */
  __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0)); /* which registers the system keeps */
  if ((low & 0x06u) != 0x06u || !__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(b & 1u << 5)) return 1;
  const unsigned wide = 1u << 16 | 1u << 17 | 1u << 31; /* AVX512F, DQ, VL */
  return (low & 0xe6u) == 0xe6u && (b & wide) == wide ? 3 : 2;
}
#else
/* Number of kinds that this processor can stand for; the last of them is the fastest. */
static inline int fk_levels(void) {
#ifdef FK_X86
  __builtin_cpu_init();
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return 1;
  if (!__builtin_cpu_supports("avx512f") || !__builtin_cpu_supports("avx512dq") ||
      !__builtin_cpu_supports("avx512vl"))
    return 2;
  return 3;
#else
  return 1;
#endif
}
#endif

static inline const char *fk_level_name(int level) {
  static const char *const names[] = {"portable", "x86-64-v3", "x86-64-v4"};
  return names[level];
}

#endif
