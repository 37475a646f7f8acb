/* The kinds of processors that the arithmetic is compiled for, the fastest last. */
#ifndef FUZZYKF_PROCESSOR_H
#define FUZZYKF_PROCESSOR_H

#if defined(__x86_64__) && defined(__GNUC__)
#define FK_X86 1
#endif

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

static inline const char *fk_level_name(int level) {
  static const char *const names[] = {"portable", "x86-64-v3", "x86-64-v4"};
  return names[level];
}

#endif
