/* Moments of memberships on a lattice; see fuzzykf/engine/numpy/grid.py. */
#ifndef FUZZYKF_MOMENTS_H
#define FUZZYKF_MOMENTS_H

#include "exact.h"

FK_EXACT_BEGIN

/* Sums of a line at a time: independent chains, which the processor adds up in parallel. */
#define FK_SUMS 4

/* Weight of a node under the trapezoidal rule. */
FK_INLINE double fk_weight(fk_index j, fk_index n) { return j == 0 || j == n - 1 ? 0.5 : 1.0; }

/* First (d) and second (d, d) moments of masses about zero, by the trapezoidal rule; deviations along axis k
 * start at deviation[k]. */
FK_STATIC void fk_moments(int d, const fk_index *shape, const double *mass, const double *const *deviation,
                          double *first, double *second) {
  const fk_index n = shape[d - 1];
  const double *along = deviation[d - 1];
  fk_index lines = 1, at[FK_AXES] = {0};
  double total = 0.0;
  for (int k = 0; k < d - 1; k++) lines *= shape[k];
  for (int k = 0; k < d; k++) first[k] = 0.0;
  for (int k = 0; k < d * d; k++) second[k] = 0.0;
  for (fk_index line = 0; line < lines; line++, mass += n) {
    double sums[3][FK_SUMS] = {{0.0}}, s[3], weight = 1.0;
    for (fk_index j = 0; j < n;) {
      const fk_index stop = j + FK_SUMS <= n ? FK_SUMS : n - j;
      for (fk_index c = 0; c < stop; c++) {
        const double m = mass[j + c], m1 = m * along[j + c];
        sums[0][c] += m, sums[1][c] += m1, sums[2][c] += m1 * along[j + c];
      }
      j += stop;
    }
    for (int p = 0; p < 3; p++) {
      s[p] = 0.0;
      for (int c = 0; c < FK_SUMS; c++) s[p] += sums[p][c];
    }
    for (fk_index j = 0; j < n; j += n > 1 ? n - 1 : 1) { /* the ends count half */
      const double m = 0.5 * mass[j];
      s[0] -= m, s[1] -= m * along[j], s[2] -= m * along[j] * along[j];
    }
    for (int k = 0; k < d - 1; k++) weight *= fk_weight(at[k], shape[k]);
    total += weight * s[0];
    first[d - 1] += weight * s[1];
    second[d * d - 1] += weight * s[2];
    for (int k = 0; k < d - 1; k++) {
      const double off = weight * deviation[k][at[k]];
      first[k] += off * s[0];
      second[k * d + d - 1] += off * s[1];
      for (int m = 0; m <= k; m++) second[k * d + m] += off * deviation[m][at[m]] * s[0];
    }
    for (int k = d - 2; k >= 0; k--) {
      if (++at[k] < shape[k]) break;
      at[k] = 0;
    }
  }
  for (int k = 0; k < d; k++) {
    first[k] /= total;
    for (int m = 0; m <= k; m++) {
      double *here = second + k * d + m, *there = second + m * d + k;
      if (k == d - 1 && m < k) *here = *there; /* gathered in the last column */
      *here /= total;
      *there = *here;
    }
  }
}

FK_EXACT_END

#endif
