/* Convolution of lines of costs with a parabola; see fuzzykf/engine/numpy/convolution.py. */
#ifndef FUZZYKF_CONVOLUTION_H
#define FUZZYKF_CONVOLUTION_H

#include "exact.h"

/* Admissible error of a refined cost, as told by the change of the second difference. */
#define FK_RELATIVE_ERROR 0.1
#define FK_ABSOLUTE_ERROR 0.02

FK_EXACT_BEGIN

typedef struct {
  double y0, dy, x0, dx; /* origins and steps of sources and targets */
  fk_index n, m;         /* their numbers */
  double curvature;
} fk_parabolas;

/* Minimum of the parabola through three equidistant costs, the middle one the least. */
FK_INLINE double fk_refine(double before, double left, double middle, double right, double after) {
  const double slope = right - left, bend = left - 2.0 * middle + right;
  const double least = fk_least(fk_least(left, middle), right);
  const double refined = fk_most(least - slope * slope / (8.0 * bend), 0.0);
  const double low = before - 2.0 * left + middle, high = middle - 2.0 * right + after;
  const double change = fabs(bend - (left < right ? low : high));
  const int usable = (change <= 8.0 * (FK_RELATIVE_ERROR * refined + FK_ABSOLUTE_ERROR)) &
                     (bend > 0.0) & (least == middle);
  return usable ? refined : least;
}

/* Vertices of the lower convex hull of the points (j, cost_j + bend j^2), by their j; returns their number.
 * ``slope`` holds for each vertex the slope of cost from the one before it. */
FK_INLINE fk_index fk_hull(const double *cost, fk_index n, double bend, fk_index *vertex, double *slope) {
  fk_index size = 0;
  for (fk_index j = 0; j < n; j++) {
    if (!isfinite(cost[j])) continue;
    double chord = 0.0;
    while (size > 0) {
      const fk_index b = vertex[size - 1];
      chord = cost[j] - cost[b];
      if (j - b > 1) chord /= (double)(j - b);
      if (size == 1 || !(slope[size - 1] - chord >= bend * (double)(j - vertex[size - 2]))) break;
      size--;
    }
    vertex[size] = j;
    slope[size++] = chord;
  }
  return size;
}

/* For every target of one line, the source of the lowest parabola; zero without any possible source.
 * vertex and slope are room for n. */
FK_STATIC void fk_envelope(const fk_parabolas *p, const double *cost, fk_index *best, fk_index *vertex,
                           double *slope) {
  const double bend = p->curvature * p->dy * p->dy, shift = p->y0 - p->x0;
  const fk_index size = fk_hull(cost, p->n, bend, vertex, slope);
  fk_index i = 0;
  for (fk_index k = 0; k + 1 < size; k++) {
    const fk_index a = vertex[k], b = vertex[k + 1];
    double crossing = (cost[b] - cost[a]) / (2.0 * bend * (double)(b - a));
    crossing += 0.5 * (double)(b + a);
    /* The first target to the right of the crossing starts the reign of the next vertex. */
    const double first = (shift + p->dy * crossing) / p->dx;
    for (; i < p->m && (double)i < first; i++) best[i] = a;
  }
  const fk_index last = size ? vertex[size - 1] : 0;
  for (; i < p->m; i++) best[i] = last;
}

/* Convolve one line; best is room for m, padded for n + 4. */
FK_STATIC void fk_convolve_parabola(const fk_parabolas *p, const double *cost, double *out, fk_index *best,
                                    fk_index *vertex, double *slope, double *padded) {
  const double c = p->curvature, dy = p->dy;
  fk_envelope(p, cost, best, vertex, slope);
  padded[0] = padded[1] = padded[p->n + 2] = padded[p->n + 3] = INFINITY;
  memcpy(padded + 2, cost, (size_t)p->n * sizeof(double));
  for (fk_index i = 0; i < p->m; i++) {
    const double *near = padded + best[i];
    const double offset = (p->x0 + p->dx * (double)i) - (p->y0 + dy * (double)best[i]);
    const double a = offset + 2.0 * dy, b = offset + dy, d = offset - dy, e = offset - 2.0 * dy;
    out[i] = fk_refine(near[0] + c * (a * a), near[1] + c * (b * b), near[2] + c * (offset * offset),
                       near[3] + c * (d * d), near[4] + c * (e * e));
  }
}

FK_STATIC void fk_refine_all(fk_index n, const double *before, const double *left, const double *middle,
                             const double *right, const double *after, double *out) {
  for (fk_index k = 0; k < n; k++) out[k] = fk_refine(before[k], left[k], middle[k], right[k], after[k]);
}

FK_EXACT_END

#endif
