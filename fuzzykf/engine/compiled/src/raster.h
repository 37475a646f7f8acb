/* Forward mapping of a lattice; see fuzzykf/engine/numpy/raster.py. */
#ifndef FUZZYKF_RASTER_H
#define FUZZYKF_RASTER_H

#include "exact.h"

FK_EXACT_BEGIN

/* Coordinates within a simplex may exceed their range by this rounding error. */
#define FK_WITHIN 1e-7

/* A cell is flat if its image is thinner than this part of its length. */
#define FK_FLATNESS 1e-9

/* Most dimensions of an image. */
#define FK_IMAGE 3

typedef struct {
  int s, d;                     /* axes of the source, dimension of the image */
  int order[FK_IMAGE];          /* axes that the simplices run along */
  fk_index stride[FK_AXES];     /* of the source nodes */
  fk_index shape[FK_IMAGE];     /* of the target */
  const double *image;          /* (source nodes, d) */
} fk_raster;

typedef struct {
  fk_index *node;
  double *position, *inverse;
} fk_cover;

/* Set ``alive`` at the lowest corners of cells, spanned by the chosen axes, that have a live corner. */
FK_STATIC void fk_live_corners(int s, const fk_index *shape, const int *chosen, unsigned char *alive) {
  fk_index size = 1, stride;
  for (int k = 0; k < s; k++) size *= shape[k];
  stride = size;
  for (int k = 0; k < s; k++) {
    const fk_index n = shape[k];
    stride = n ? stride / n : 0;
    if (!chosen[k] || !size) continue;
    for (fk_index outer = 0; outer < size; outer += n * stride) {
      unsigned char *row = alive + outer;
      for (fk_index j = 0; j < (n - 1) * stride; j++) row[j] |= row[j + stride];
      memset(row + (n - 1) * stride, 0, (size_t)stride); /* no cell begins there */
    }
  }
}

/* Set the flags of all neighbours, also across corners, of nodes that have it set. */
FK_STATIC void fk_dilate(int s, const fk_index *shape, unsigned char *flags) {
  fk_index size = 1, stride;
  for (int k = 0; k < s; k++) size *= shape[k];
  stride = size;
  for (int k = 0; k < s; k++) {
    const fk_index n = shape[k];
    stride = n ? stride / n : 0;
    if (n < 2 || !size) continue;
    for (fk_index outer = 0; outer < size; outer += n * stride) {
      unsigned char *row = flags + outer;
      /* Bit 2 keeps what a node gets, until all have given. */
      for (fk_index j = 0; j < (n - 1) * stride; j++) row[j] |= (unsigned char)((row[j + stride] & 1) << 1);
      for (fk_index j = (n - 1) * stride - 1; j >= 0; j--)
        row[j + stride] |= (unsigned char)((row[j] & 1) << 1);
      for (fk_index j = 0; j < n * stride; j++) row[j] = row[j] != 0;
    }
  }
}

/* Bounds (d) of the finite images (n, d) of flagged nodes; returns their number. */
FK_STATIC fk_index fk_span(int d, const double *image, const unsigned char *flags, fk_index n, double *low,
                           double *high) {
  fk_index count = 0;
  int some = 0;
  for (int k = 0; k < d; k++) low[k] = INFINITY, high[k] = -INFINITY;
  for (fk_index j = 0; j < n; j++) some |= !flags[j];
  for (fk_index j = 0; j < n * d; j++) some |= !(fabs(image[j]) <= DBL_MAX);
  if (!some && d == 2) {
    double a = INFINITY, b = INFINITY, c = -INFINITY, e = -INFINITY;
    for (fk_index j = 0; j < n; j++) {
      a = fk_least(a, image[2 * j]), b = fk_least(b, image[2 * j + 1]);
      c = fk_most(c, image[2 * j]), e = fk_most(e, image[2 * j + 1]);
    }
    low[0] = a, low[1] = b, high[0] = c, high[1] = e;
    return n;
  }
  for (fk_index j = 0; j < n; j++) {
    const double *x = image + j * d;
    int finite = flags[j] != 0;
    for (int k = 0; k < d; k++) finite &= fabs(x[k]) <= DBL_MAX;
    if (!finite) continue;
    count++;
    for (int k = 0; k < d; k++) low[k] = fk_least(low[k], x[k]), high[k] = fk_most(high[k], x[k]);
  }
  return count;
}

FK_STATIC fk_index fk_count(const unsigned char *flags, fk_index size) {
  fk_index count = 0;
  for (fk_index j = 0; j < size; j++) count += flags[j] != 0;
  return count;
}

/* Indices (count, s) of the flags that are set. */
FK_STATIC void fk_places(int s, const fk_index *shape, const unsigned char *flags, fk_index *out) {
  fk_index at[FK_AXES] = {0}, lines = 1;
  const fk_index n = shape[s - 1];
  for (int k = 0; k < s - 1; k++) lines *= shape[k];
  for (fk_index line = 0; line < lines; line++, flags += n) {
    for (fk_index j = 0; j < n; j++) {
      if (!flags[j]) continue;
      for (int k = 0; k < s - 1; k++) *out++ = at[k];
      *out++ = j;
    }
    for (int k = s - 2; k >= 0; k--) {
      if (++at[k] < shape[k]) break;
      at[k] = 0;
    }
  }
}

/* Adjugate of a matrix (d, d), row by row; returns the determinant. */
FK_INLINE double fk_adjugate(const int d, const double *a, double *out) {
  if (d == 1) {
    out[0] = 1.0;
    return a[0];
  }
  if (d == 2) {
    out[0] = a[3], out[3] = a[0], out[1] = -a[1], out[2] = -a[2];
    return a[0] * a[3] - a[1] * a[2];
  }
  for (int k = 0; k < 3; k++) { /* row k: the cross product of the other two columns */
    const double *p = a + (k + 1) % 3, *q = a + (k + 2) % 3;
    for (int i = 0; i < 3; i++) {
      const int j = 3 * ((i + 1) % 3), l = 3 * ((i + 2) % 3);
      out[3 * k + i] = p[j] * q[l] - p[l] * q[j];
    }
  }
  return a[0] * out[0] + a[3] * out[1] + a[6] * out[2];
}

/* Floor and ceiling where they may be places on an axis; what is beyond does not matter. */
FK_INLINE double fk_floor(double x) {
  if (!(x > -1.0 && x < 1e9)) return x;
  const double whole = (double)(fk_index)x;
  return whole - (x < whole);
}

FK_INLINE double fk_ceiling(double x) {
  if (!(x > -1.0 && x < 1e9)) return x;
  const double whole = (double)(fk_index)x;
  return whole + (x > whole);
}

/* Cover target nodes by the simplices from ``*next`` on of n cells (n, s); stops before the room for
 * ``most`` nodes may not be enough.  Returns the nodes found; *next is n when all is done, and *need the
 * room that the next simplex asks for. */
FK_INLINE fk_index fk_simplices(const fk_raster *r, const int s, const int d, const fk_index *base,
                                fk_index n, fk_index most, fk_cover out, fk_index *next, fk_index *need) {
  fk_index found = 0;
  for (; *next < n; ++*next) {
    const fk_index *cell = base + *next * s;
    fk_index index = 0, low[FK_IMAGE], extent[FK_IMAGE], count = 1, at[FK_IMAGE] = {0};
    for (int k = 0; k < s; k++) index += cell[k] * r->stride[k];
    double corner[FK_IMAGE + 1][FK_IMAGE], edges[FK_IMAGE * FK_IMAGE], inverse[FK_IMAGE * FK_IMAGE];
    for (int c = 0; c <= d; c++) {
      if (c) index += r->stride[r->order[c - 1]];
      for (int k = 0; k < d; k++) corner[c][k] = r->image[index * d + k];
    }
    for (int k = 0; k < d; k++) {
      double least = corner[0][k], most_ = corner[0][k];
      int number = corner[0][k] == corner[0][k];
      for (int c = 1; c <= d; c++) {
        edges[k * d + c - 1] = corner[c][k] - corner[c - 1][k];
        least = fk_least(least, corner[c][k]);
        most_ = fk_most(most_, corner[c][k]);
        number &= corner[c][k] == corner[c][k];
      }
      const double from = fk_most(fk_ceiling(least - FK_WITHIN), 0.0);
      const double to = fk_floor(fk_least(most_ + FK_WITHIN, (double)(r->shape[k] - 1)));
      if (!(number && to >= from)) {
        count = 0;
        break;
      }
      low[k] = (fk_index)from;
      extent[k] = (fk_index)(to - from + 1.0);
      count *= extent[k];
    }
    if (!count) continue;
    const double determinant = fk_adjugate(d, edges, inverse);
    if (!(fabs(determinant) > 0.0)) continue;
    if (found + count > most) {
      *need = count;
      return found;
    }
    for (int k = 0; k < d * d; k++) inverse[k] /= determinant;
    for (fk_index j = 0; j < count; j++) {
      fk_index node = 0;
      double within[FK_IMAGE];
      int ordered = 1;
      for (int k = 0; k < d; k++) node = node * r->shape[k] + low[k] + at[k];
      for (int i = 0; i < d; i++) {
        within[i] = 0.0;
        for (int k = 0; k < d; k++) within[i] += inverse[i * d + k] * ((double)(low[k] + at[k]) - corner[0][k]);
      }
      /* Inside if 1 >= within_1 >= ... >= within_d >= 0. */
      ordered &= within[0] - 1.0 <= FK_WITHIN;
      for (int i = 1; i < d; i++) ordered &= within[i] - within[i - 1] <= FK_WITHIN;
      ordered &= 0.0 - within[d - 1] <= FK_WITHIN;
      if (ordered) {
        double *position = out.position + found * s;
        out.node[found] = node;
        for (int k = 0; k < s; k++) position[k] = (double)cell[k];
        for (int i = 0; i < d; i++) position[r->order[i]] += fk_least(fk_most(within[i], 0.0), 1.0);
        for (int k = 0; k < d * d; k++) out.inverse[found * d * d + k] = inverse[k];
        found++;
      }
      for (int k = d - 1; k >= 0; k--) {
        if (++at[k] < extent[k]) break;
        at[k] = 0;
      }
    }
  }
  *need = 0;
  return found;
}

FK_STATIC fk_index fk_cover_simplices(const fk_raster *r, const fk_index *base, fk_index n, fk_index most,
                                      fk_cover out, fk_index *next, fk_index *need) {
  if (r->d == 1) return fk_simplices(r, r->s, 1, base, n, most, out, next, need);
  if (r->d == 2 && r->s == 2) return fk_simplices(r, 2, 2, base, n, most, out, next, need);
  if (r->d == 2) return fk_simplices(r, r->s, 2, base, n, most, out, next, need);
  return fk_simplices(r, r->s, 3, base, n, most, out, next, need);
}

/* Keep of the flags of cells those whose image has no volume. */
FK_STATIC void fk_keep_flat(int s, int d, const fk_index *shape, const double *image, unsigned char *flags) {
  fk_index size = 1, stride[FK_AXES];
  for (int k = s - 1; k >= 0; k--) stride[k] = size, size *= shape[k];
  for (fk_index j = 0; j < size; j++) {
    if (!flags[j]) continue;
    double gram[FK_IMAGE * FK_IMAGE] = {0}, adjugate[FK_IMAGE * FK_IMAGE], length = 0.0, threshold;
    for (int axis = 0; axis < s; axis++) {
      double edge[FK_IMAGE];
      for (int k = 0; k < d; k++) edge[k] = image[(j + stride[axis]) * d + k] - image[j * d + k];
      for (int i = 0; i < d; i++)
        for (int k = 0; k < d; k++) gram[i * d + k] += edge[i] * edge[k];
    }
    for (int k = 0; k < d; k++) length += gram[k * d + k];
    threshold = FK_FLATNESS * FK_FLATNESS;
    threshold *= d == 1 ? length : d == 2 ? length * length : length * length * length;
    flags[j] = fk_adjugate(d, gram, adjugate) <= threshold;
  }
}

/* Move positions (n, s) by one Newton step, inverse (n, d, d) times miss (n, d), along the axes of ``order``,
 * where it is as small as it should be and stays within the lattice. */
FK_STATIC void fk_correct(int s, int d, const int *order, const fk_index *shape, const double *inverse,
                          const double *miss, fk_index n, double *position) {
  for (fk_index j = 0; j < n; j++, position += s, inverse += d * d, miss += d) {
    double change[FK_IMAGE];
    int good = 1;
    for (int i = 0; i < d; i++) {
      change[i] = 0.0;
      for (int k = 0; k < d; k++) change[i] += inverse[i * d + k] * miss[k];
      const double moved = position[order[i]] + change[i];
      good &= (fabs(change[i]) <= 0.5) & (moved >= 0.0) & (moved <= (double)(shape[order[i]] - 1));
    }
    if (good)
      for (int i = 0; i < d; i++) position[order[i]] += change[i];
  }
}

/* Keep of the flags of n source nodes those whose image (n, d) lies within a target of this shape, no node
 * of which around it is finite. */
FK_STATIC void fk_keep_stranded(int d, const fk_index *shape, const double *out, const double *image, fk_index n,
                                unsigned char *flags) {
  for (fk_index j = 0; j < n; j++) {
    const double *x = image + j * d;
    int inside = flags[j] != 0, drawn = 0;
    for (int k = 0; k < d; k++) inside &= isfinite(x[k]) && x[k] > -1.0 && x[k] < (double)shape[k];
    for (int c = 0; inside && !drawn && c < 1 << d; c++) {
      fk_index node = 0;
      int there = 1;
      for (int k = 0; k < d; k++) {
        const fk_index at = (fk_index)fk_floor(x[k]) + (c >> k & 1);
        there &= at >= 0 && at < shape[k];
        node = node * shape[k] + at;
      }
      drawn = there && isfinite(out[node]);
    }
    flags[j] = inside && !drawn;
  }
}

FK_EXACT_END

#endif
