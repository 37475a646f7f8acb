/* Interpolation of costs on regular lattices; see fuzzykf/engine/numpy/grid.py. */
#ifndef FUZZYKF_INTERPOLATION_H
#define FUZZYKF_INTERPOLATION_H

#include "exact.h"

FK_EXACT_BEGIN

/* Second differences agree if they differ by less than this part of them, or by this cost. */
#define FK_ROUGHNESS 0.5
#define FK_NEGLIGIBLE 0.02

/* Only tails that have reached this part of the limit were cut off by it. */
#define FK_CUT 0.7

/* A tail is smooth, or a parabola, if its second difference changes by less than this. */
#define FK_TAIL_ROUGHNESS 0.02
#define FK_EXACT_PARABOLA 1e-8

/* Positions are on nodes if they are off by less than this (in steps), here for so many at a time. */
#define FK_ON_NODE 1e-11
#define FK_POSITIONS (1 << 15)

/* How far (in steps) beyond the last node a position still counts as on it. */
#define FK_BEYOND 1e-9

typedef struct {
  int d, scale;
  fk_index shape[FK_AXES], stride[FK_AXES]; /* at least four nodes along each axis */
  const double *cost;
} fk_lattice;

/* Second difference between four nodes in a row; NaN where its two values disagree. */
FK_INLINE double fk_bend(const double *node, fk_index stride) {
  const double first = node[0], second = node[stride], third = node[2 * stride], fourth = node[3 * stride];
  const double slope = third - second, low = slope - (second - first), high = (fourth - third) - slope;
  const double allowed = FK_ROUGHNESS * (fabs(low) + fabs(high)) + FK_NEGLIGIBLE;
  const int agreed = (fabs(low - high) <= allowed) & (allowed < INFINITY);
  return agreed ? (fabs(low) < fabs(high) ? low : high) : NAN;
}

/* Shift by which memberships too small for a float are kept from vanishing: the best cost, if finite. */
FK_INLINE double fk_shift(double best, int scale) { return scale == FK_LOG && isfinite(best) ? best : 0.0; }

/* Lower of the two nodes around a position along one axis of n nodes, and the part of the way from there. */
FK_INLINE fk_index fk_below(double position, fk_index n, double *part) {
  const double last = (double)n - 2.0, start = position < 0.0 ? 0.0 : position;
  const fk_index node = start < last ? (fk_index)start : n - 2;
  *part = fk_least(fk_most(position - (double)node, 0.0), 1.0);
  return node;
}

/* Cost at a position within the lattice, linear in the memberships of the nodes around it; infinite if none of
 * them is possible: a finite cost of the impossible would be bent below its limit by what refines sums. */
FK_STATIC double fk_between_memberships(const fk_lattice *g, const double *position) {
  const int corners = 1 << g->d;
  const double *node = g->cost;
  double t[FK_AXES], best = INFINITY, sum = 0.0;
  for (int k = 0; k < g->d; k++) node += g->stride[k] * fk_below(position[k], g->shape[k], t + k);
  for (int pass = 0; pass < 2; pass++) {
    const double shift = fk_shift(best, g->scale);
    for (int c = 0; c < corners; c++) {
      fk_index offset = 0;
      double weight = 1.0;
      for (int k = 0; k < g->d; k++) {
        const int up = c >> (g->d - 1 - k) & 1;
        offset += up ? g->stride[k] : 0;
        weight *= up ? t[k] : 1.0 - t[k];
      }
      if (!pass)
        best = fk_least(best, node[offset]);
      else
        sum += weight * fk_to_membership(node[offset] - shift, g->scale);
    }
    if (best == INFINITY) return INFINITY;
  }
  if (!(sum > 0.0)) return INFINITY;
  return fk_shift(best, g->scale) + fk_from_membership(sum, g->scale);
}

/* Cost at a position within the lattice.  d is g->d, and bit k of ``whole`` says that the position is a
 * node along axis k: given as constants, they make loops of known length. */
FK_INLINE double fk_at(const fk_lattice *g, const int d, const int whole, const double *position) {
  fk_index corner[FK_AXES], place = 0;
  double t[FK_AXES], value = 0.0;
  for (int k = 0; k < d; k++) {
    if (whole >> k & 1)
      corner[k] = (fk_index)(position[k] + 0.5);
    else
      corner[k] = fk_below(position[k], g->shape[k], t + k);
    place += corner[k] * g->stride[k];
  }
  const double *node = g->cost + place;
  for (int c = 0; c < 1 << d; c++) {
    fk_index offset = 0;
    double weight = 1.0;
    int counts = 1;
    for (int k = 0; k < d; k++) {
      const int up = c >> (d - 1 - k) & 1;
      if (whole >> k & 1) {
        counts &= !up;
        continue;
      }
      offset += up ? g->stride[k] : 0;
      weight *= up ? t[k] : 1.0 - t[k];
    }
    if (counts) value += weight * node[offset];
  }
  for (int k = 0; k < d; k++) { /* four nodes along the edge that is nearest in the other directions */
    if (whole >> k & 1) continue;
    fk_index first = corner[k] > 0 ? corner[k] - 1 : 0;
    if (first > g->shape[k] - 4) first = g->shape[k] - 4;
    const double *edge = g->cost + first * g->stride[k];
    for (int m = 0; m < d; m++)
      if (m != k) edge += (corner[m] + (!(whole >> m & 1) && t[m] > 0.5)) * g->stride[m];
    value -= 0.5 * t[k] * (1.0 - t[k]) * fk_bend(edge, g->stride[k]);
  }
  if (!isfinite(value)) value = fk_between_memberships(g, position);
  return value < 0.0 ? 0.0 : value; /* no membership exceeds one */
}

FK_INLINE int fk_inside(const fk_lattice *g, const int d, const double *position) {
  int inside = 1;
  for (int k = 0; k < d; k++)
    inside &= (position[k] >= -FK_BEYOND) & (position[k] <= (double)(g->shape[k] - 1) + FK_BEYOND);
  return inside;
}

FK_INLINE void fk_at_all(const fk_lattice *g, const int d, const int whole, const double *position, fk_index n,
                         double *out) {
  for (fk_index j = 0; j < n; j++)
    out[j] = fk_inside(g, d, position + j * d) ? fk_at(g, d, whole, position + j * d) : INFINITY;
}

/* Along which axes all positions inside are nodes, as bits; ``known`` are those that need no test. */
FK_INLINE int fk_whole(const fk_lattice *g, const int d, const double *position, fk_index n, int known) {
  int open = ((1 << d) - 1) & ~known;
  for (fk_index j = 0; j < n && open; j++)
    if (fk_inside(g, d, position + j * d))
      for (int k = 0; k < d; k++) {
        const double along = position[j * d + k];
        const double off = along - (double)(fk_index)(fk_most(along, 0.0) + 0.5);
        if (fabs(off) > FK_ON_NODE) open &= ~(1 << k);
      }
  return open | known;
}

/* Costs at up to FK_POSITIONS positions (n, d), which are known to be nodes along some axes. */
FK_STATIC void fk_interpolate_some(const fk_lattice *g, const double *position, fk_index n, int known,
                                   double *out) {
  const int whole = fk_whole(g, g->d, position, n, known);
  if (g->d == 1 && whole == 0)
    fk_at_all(g, 1, 0, position, n, out);
  else if (g->d == 2 && whole == 0)
    fk_at_all(g, 2, 0, position, n, out);
  else if (g->d == 2 && whole == 1)
    fk_at_all(g, 2, 1, position, n, out);
  else if (g->d == 2 && whole == 2)
    fk_at_all(g, 2, 2, position, n, out);
  else if (g->d == 3 && whole == 0)
    fk_at_all(g, 3, 0, position, n, out);
  else
    fk_at_all(g, g->d, whole, position, n, out);
}

/* Costs at positions (n, d) in steps from the first node; infinite outside. */
FK_STATIC void fk_interpolate(const fk_lattice *g, const double *position, fk_index n, double *out) {
  for (fk_index start = 0; start < n; start += FK_POSITIONS) {
    const fk_index count = n - start < FK_POSITIONS ? n - start : FK_POSITIONS;
    fk_interpolate_some(g, position + start * g->d, count, 0, out + start);
  }
}

/* Along which axes the positions shift + matrix n are nodes for all whole n: as bits, not all perhaps. */
FK_STATIC int fk_whole_rows(int d, const double *matrix, const double *shift) {
  int whole = 0;
  for (int i = 0; i < d; i++) {
    int exact = fabs(shift[i]) < 1e9 && shift[i] == (double)(fk_index)shift[i];
    for (int k = 0; k < d; k++) exact &= fabs(matrix[i * d + k]) == (matrix[i * d + k] != 0.0);
    whole |= exact << i;
  }
  return whole;
}

/* Costs at positions shift + matrix n for the nodes from number ``start`` on, ``count`` of them, of a lattice of
 * this shape; room for their positions, not more than FK_POSITIONS. */
FK_STATIC void fk_pull_back(const fk_lattice *g, const double *matrix, const double *shift, const fk_index *shape,
                            fk_index start, fk_index count, double *position, double *out) {
  const int d = g->d;
  const fk_index length = shape[d - 1];
  fk_index node[FK_AXES], rest = start;
  for (int k = d - 1; k >= 0; k--) node[k] = rest % shape[k], rest /= shape[k];
  for (fk_index j = 0; j < count;) { /* the rest of one line, or of what is wanted */
    const fk_index stop = length - node[d - 1] < count - j ? length - node[d - 1] : count - j;
    for (int i = 0; i < d; i++) {
      const double slope = matrix[i * d + d - 1], first = (double)node[d - 1];
      double sum = shift[i], *to = position + j * d + i;
      for (int k = 0; k < d - 1; k++) sum += matrix[i * d + k] * (double)node[k];
      for (fk_index n = 0; n < stop; n++) to[n * d] = sum + slope * (first + (double)n);
    }
    j += stop;
    node[d - 1] += stop;
    for (int k = d - 1; k > 0 && node[k] == shape[k]; k--) node[k] = 0, node[k - 1]++;
  }
  fk_interpolate_some(g, position, count, fk_whole_rows(d, matrix, shift), out);
}

/* Least cost of the n nodes whose image (n, d) is outside a box (d, 2); infinite if there is none. */
FK_STATIC double fk_least_outside(const double *image, const double *cost, fk_index n, int d, const double *box) {
  double least = INFINITY;
  for (fk_index j = 0; j < n; j++) {
    int outside = 0;
    for (int k = 0; k < d; k++) outside |= (image[j * d + k] < box[2 * k]) | (image[j * d + k] > box[2 * k + 1]);
    least = outside ? fk_least(least, cost[j]) : least;
  }
  return least;
}

/* Costs (lines, m) between the nodes of lines (lines, n), at the same positions (m) on each. */
FK_STATIC void fk_interpolate_lines(const double *cost, fk_index lines, fk_index n, const double *position,
                                    fk_index m, int scale, double *out) {
  for (fk_index line = 0; line < lines; line++) {
    fk_lattice g = {1, scale, {n}, {1}, cost + line * n};
    for (fk_index j = 0; j < m; j++)
      out[line * m + j] = fk_inside(&g, 1, position + j) ? fk_at(&g, 1, 0, position + j) : INFINITY;
  }
}

/* Continue one line of n nodes into the impossible ones at its end, where it ends in a smooth tail. */
FK_STATIC void fk_continue_end(double *line, fk_index n, fk_index stride, double limit) {
  fk_index last = n - 1;
  while (last >= 0 && !isfinite(line[last * stride])) last--;
  if (last < 3 || last == n - 1) return;
  const double a = line[last * stride], b = line[(last - 1) * stride], c = line[(last - 2) * stride];
  const double d = line[(last - 3) * stride], bend = (a - b) - (b - c);
  double slope = a - b;
  const double change = fabs(bend - (b - 2.0 * c + d)), upward = fk_most(bend, 0.0);
  if (!(change <= FK_TAIL_ROUGHNESS * (fabs(bend) + 1.0) && isfinite(change))) return;
  if (!(a + slope + upward >= FK_CUT * limit)) return;
  /* Only an exact parabola is trusted to come down again. */
  if (!(change <= FK_EXACT_PARABOLA * (upward + 1.0))) slope = fk_most(slope, 0.0);
  for (fk_index j = last + 1; j < n; j++) {
    const double steps = (double)(j - last);
    line[j * stride] = fk_most(a + slope * steps + 0.5 * upward * steps * (steps + 1.0), FK_CUT * limit);
  }
}

/* Continue, in place, the ends of all lines of a lattice. */
FK_STATIC void fk_continue_tails(int d, const fk_index *shape, double *cost, double limit) {
  fk_index size = 1, stride = 1;
  for (int k = 0; k < d; k++) size *= shape[k];
  for (int k = 0; k < d; k++) {
    const fk_index n = shape[k];
    stride = size;
    for (int m = 0; m <= k; m++) stride = shape[m] ? stride / shape[m] : 0;
    if (n <= 4 || !size) continue;
    for (fk_index outer = 0; outer < size; outer += n * stride)
      for (fk_index inner = 0; inner < stride; inner++) {
        double *line = cost + outer + inner;
        fk_continue_end(line, n, stride, limit);
        fk_continue_end(line + (n - 1) * stride, n, -stride, limit);
      }
  }
}

FK_EXACT_END

#endif
