/* Back into an observation of which a part was missing, in numbers one by one; see gap_backward.py of the engine in
 * NumPy, which has the equations.
 *
 * States are those of gaps.h: rows of branches, mean and lower triangular root of (u, X).  Moments of windows stand
 * branch by branch: means (b, nu) and lower triangular roots (b, nu, nu) of what is unknown of them. */
#ifndef FUZZYKF_GAP_BACK_H
#define FUZZYKF_GAP_BACK_H

#include "gaps.h"

#define FK_BACK_LARGEST (2 * FK_GAPS_LARGEST)
#define FK_TELLING 0.5 /* where the future leaves at most this share of a variance, it is an observation of it */

/* Make the first `upto` rows of A (rows, cols), `stride` apart, lower triangular with a diagonal that is not negative. */
FK_INLINE void fk_triangular(double *A, int stride, int rows, int cols, int upto) {
  for (int p = 0; p < upto; p++) {
    for (int c = p + 1; c < cols; c++) {
      const double a = A[p * stride + p], b = A[p * stride + c], h = sqrt(a * a + b * b);
      if (b == 0.0 || !(h > 0.0)) continue;
      const double to_a = a / h, to_b = b / h;
      A[p * stride + p] = h, A[p * stride + c] = 0.0;
      for (int r = p + 1; r < rows; r++) {
        const double x = A[r * stride + p], z = A[r * stride + c];
        A[r * stride + p] = to_a * x + to_b * z;
        A[r * stride + c] = to_a * z - to_b * x;
      }
    }
    if (A[p * stride + p] < 0.0)
      for (int r = p; r < rows; r++) A[r * stride + p] = -A[r * stride + p];
  }
}

/* What is zero on a diagonal belongs to what cannot be. */
FK_INLINE double fk_regular(double a) { return a == 0.0 ? 1.0 : a; }

/* Mix one more component of this weight into mean (d) and lower triangular root (d, d) of mass `mass`; its own root are
 * d columns.  Where there is no mass it takes the place of what is there: what cannot be keeps any finite moments. */
FK_INLINE void fk_mix_in(const int d, double *mass, double *mean, double *root, double weight, const double *x,
                         const double *columns) {
  if (!(*mass > 0.0)) {
    memcpy(mean, x, d * sizeof(double));
    memcpy(root, columns, (size_t)d * d * sizeof(double));
    *mass = weight;
    return;
  }
  if (!(weight > 0.0)) return;
  const double total = *mass + weight, f = weight / total, g = *mass / total;
  *mass = total;
  if (d == 1) {
    const double off = x[0] - mean[0];
    root[0] = sqrt(g * root[0] * root[0] + f * columns[0] * columns[0] + f * g * off * off);
    mean[0] += f * off;
    return;
  }
  const int wide = 2 * d + 1;
  const double old = sqrt(g), fresh = sqrt(f);
  double A[FK_GAPS_LARGEST * (2 * FK_GAPS_LARGEST + 1)];
  for (int r = 0; r < d; r++) {
    const double off = x[r] - mean[r];
    for (int c = 0; c < d; c++) {
      A[r * wide + c] = old * root[r * d + c];
      A[r * wide + d + 1 + c] = fresh * columns[r * d + c];
    }
    A[r * wide + d] = old * fresh * off;
    mean[r] += f * off;
  }
  fk_triangular(A, wide, d, wide, d);
  for (int r = 0; r < d; r++) memcpy(root + r * d, A + r * wide, d * sizeof(double));
}

#define FK_STATE(rows, e, b, r, ld) ((rows) + ((size_t)(b) * (1 + (e) + (e) * (e)) + (r)) * (ld))

/* What a pair of nodes expects of Y' (q), and columns of a root of Y' and u, rows `cols` apart, from a node of a state. */
FK_INLINE void fk_see(const fk_gaps *k, const int q, const int w, const int nu, const fk_holes *h, const double *state,
                      int i, int s, int j, const double *window, double *expected, double *A, int cols, int below) {
  const int ld = fk_padded(k->M1), to = fk_padded(k->M2), m = k->m, e = nu + m, N = 2 + (m + q) * (w + 1) + m * m;
  const double *cell = k->cells + (size_t)s * k->size * to + j, *mu = state + ld + i, *T = state + (size_t)(1 + e) * ld + i;
  for (int r = 0; r < q; r++) {
    double a = cell[(size_t)(2 + q * w + r) * to], *row = A + r * cols;
    for (int t = 0, g = 0; t < w; t++) {
      const int is_open = g < nu && h->u[g] == t;
      a += cell[(size_t)(2 + r * w + t) * to] * (is_open ? mu[(size_t)g * ld] : window[t]);
      g += is_open;
    }
    expected[r] = a;
    for (int c = 0; c < nu; c++) {
      double sum = 0.0;
      for (int g = c; g < nu; g++) sum += cell[(size_t)(2 + r * w + h->u[g]) * to] * T[(size_t)(g * e + c) * ld];
      row[c] = sum;
    }
    for (int c = 0; c < q; c++) row[nu + c] = c <= r ? cell[(size_t)(N + (m + r) * (m + q) + m + c) * to] : 0.0;
  }
  for (int r = 0; r < nu; r++) {
    double *row = A + (below + r) * cols;
    for (int c = 0; c < nu + q; c++) row[c] = c <= r ? T[(size_t)(r * e + c) * ld] : 0.0;
  }
}

FK_INLINE size_t fk_told_scratch(const fk_gaps *k, int n, int nu) {
  return (size_t)n * k->depth * k->M2 * (3 + nu + nu * nu) + 2 * (size_t)k->M2;
}

/* All of y is there and nothing unknown is left in the window: tell each branch of it, and of the probabilities
 * `after` (M2) of the nodes that follow.  p (n M1), mean (n M1, nu), root (n M1, nu, nu); log_pairs (depth, M2) is log
 * P_ij + log N(y; ...) given y_1..k.  Returns 0, and nothing of use, after an outlier, whose digits are for NumPy. */
FK_INLINE int fk_told_sized(const fk_gaps *k, const int q, const int w, const int nu, const fk_holes *h, const double *rows,
                            int n, const double *log_p, const double *window, const double *y, const double *after, double *p,
                            double *mean, double *root, double *log_pairs, double *scratch) {
  const int M1 = k->M1, M2 = k->M2, depth = k->depth, e = nu + k->m, ld = fk_padded(M1), to = fk_padded(M2), cols = nu + q;
  const int size = 3 + nu + nu * nu; /* of a pair: exponent, inverse of the root of the determinant, weight, moments */
  const double constant = 0.91893853320467274178 * q;
  double *pairs = scratch, *top = pairs + (size_t)n * depth * M2 * size, *column = top + M2;
  double A[FK_GAPS_LARGEST * FK_BACK_LARGEST], expected[FK_GAPS_LARGEST];
  for (int j = 0; j < M2; j++) top[j] = -DBL_MAX, column[j] = 0.0;
  double *one = pairs;
  for (int b = 0; b < n; b++)
    for (int s = 0; s < depth; s++)
      for (int j = 0; j < M2; j++, one += size) {
        const int i = k->source[(size_t)s * to + j];
        const double *state = FK_STATE(rows, e, b, 0, ld);
        double l = k->cells[((size_t)s * k->size + 1) * to + j] + state[i], inverse = 1.0;
        fk_see(k, q, w, nu, h, state, i, s, j, window, expected, A, cols, q);
        fk_triangular(A, cols, q + nu, cols, q);
        for (int r = 0; r < nu; r++) one[3 + r] = state[(size_t)(1 + r) * ld + i];
        for (int r = 0; r < q; r++) {
          if (!(A[r * cols + r] > 0.0)) return 0;
          const double scale = 1.0 / A[r * cols + r], white = (y[r] - expected[r]) * scale;
          inverse *= scale;
          l -= 0.5 * white * white;
          for (int t = r + 1; t < q; t++) expected[t] += A[t * cols + r] * white;
          for (int t = 0; t < nu; t++) one[3 + t] += A[(q + t) * cols + r] * white;
        }
        for (int r = 0; r < nu; r++)
          for (int c = 0; c < nu; c++) one[3 + nu + r * nu + c] = A[(q + r) * cols + q + c];
        one[0] = l, one[1] = inverse;
        if (l > top[j]) top[j] = l;
      }
  one = pairs;
  for (int a = 0; a < n * depth; a++)
    for (int j = 0; j < M2; j++, one += size) {
      one[2] = one[1] * exp(one[0] - top[j]);
      column[j] += one[2];
    }
  for (int j = 0; j < M2; j++)
    if (top[j] > FK_DEAD && (top[j] - constant < FK_NEAR || !(column[j] > FK_TINY && column[j] < FK_HUGE))) return 0;
  for (int s = 0; s < depth; s++)
    for (int j = 0; j < M2; j++) {
      const double *first = pairs + ((size_t)s * M2 + j) * size;
      const size_t next = (size_t)depth * M2 * size;
      const int i = k->source[(size_t)s * to + j];
      double sum = 0.0, reference = top[j];
      for (int b = 0; b < n; b++) sum += first[b * next + 2];
      if (!(sum > FK_TINY)) { /* it is small beside other pairs of the column */
        reference = -DBL_MAX, sum = 0.0;
        for (int b = 0; b < n; b++) reference = fmax(reference, first[b * next]);
        for (int b = 0; b < n; b++) sum += first[b * next + 1] * exp(first[b * next] - reference);
      }
      const int is_there = reference > FK_DEAD && log_p[i] > FK_DEAD;
      log_pairs[s * M2 + j] = is_there ? log(sum) + reference - constant - log_p[i] : FK_LOG_ZERO;
    }
  memset(p, 0, (size_t)n * M1 * sizeof(double));
  one = pairs;
  for (int b = 0; b < n; b++)
    for (int s = 0; s < depth; s++)
      for (int j = 0; j < M2; j++, one += size) {
        const size_t row = (size_t)b * M1 + k->source[(size_t)s * to + j];
        const double joint = top[j] > FK_DEAD ? one[2] / column[j] * after[j] : 0.0;
        fk_mix_in(nu, p + row, mean + row * nu, root + row * nu * nu, joint, one + 3, one + 3 + nu);
      }
  return 1;
}

FK_STATIC int fk_told(const fk_gaps *k, const fk_holes *h, const double *rows, int n, const double *log_p, const double *window,
                      const double *y, const double *after, double *p, double *mean, double *root, double *log_pairs,
                      double *scratch) {
#define FK_TOLD(q, w, nu) fk_told_sized(k, q, w, nu, h, rows, n, log_p, window, y, after, p, mean, root, log_pairs, scratch)
  return k->q == 1 && k->w == 1 && h->nu == 1 ? FK_TOLD(1, 1, 1) : FK_TOLD(k->q, k->w, h->nu);
#undef FK_TOLD
}

/* Carry smoothed moments of the next window back: given each branch (depth, M2) that follows, of probability joint, told
 * (depth M2, w) and a root (depth M2, w, r) of it, whole windows.  state: nodes of one branch.  p (M1), mean (M1, nu),
 * root (M1, nu, nu) are those of the window here, given each node. */
FK_STATIC void fk_carry(const fk_gaps *k, const fk_holes *h, const double *state, const double *window, const double *joint,
                        const double *told, const double *told_root, int w_to, int r_to, double *p, double *mean, double *root) {
  const int nu = h->nu, q = k->q, kept = h->kept, given = q + kept, cols = nu + q, M2 = k->M2, to = fk_padded(M2);
  const int ld = fk_padded(k->M1), wide = nu + r_to + cols;
  double A[2 * FK_BACK_LARGEST * FK_BACK_LARGEST], expected[FK_BACK_LARGEST], J[FK_BACK_LARGEST], x[FK_GAPS_LARGEST];
  double columns[FK_GAPS_LARGEST * 4 * FK_BACK_LARGEST], left[FK_GAPS_LARGEST * FK_GAPS_LARGEST];
  int at[FK_BACK_LARGEST]; /* where the variables stand in the next window */
  for (int r = 0; r < q; r++) at[r] = r;
  for (int r = 0; r < kept; r++) at[q + r] = h->u[r] + q;
  memset(p, 0, k->M1 * sizeof(double));
  for (int s = 0; s < k->depth; s++)
    for (int j = 0; j < M2; j++) {
      const int i = k->source[(size_t)s * to + j];
      const size_t pair = (size_t)s * M2 + j;
      fk_see(k, q, k->w, nu, h, state, i, s, j, window, expected, A, cols, given);
      for (int r = 0; r < kept; r++) {
        memcpy(A + (q + r) * cols, A + (given + r) * cols, cols * sizeof(double));
        expected[q + r] = state[(size_t)(1 + r) * ld + i];
      }
      fk_triangular(A, cols, given + nu, cols, given);
      for (int r = 0; r < nu; r++) {
        const double *cross = A + (given + r) * cols;
        x[r] = state[(size_t)(1 + r) * ld + i];
        for (int c = 0; c < r_to; c++) columns[r * wide + c] = 0.0;
        for (int c = given - 1; c >= 0; c--) { /* J L = cross */
          double a = cross[c];
          for (int t = c + 1; t < given; t++) a -= J[t] * A[t * cols + c];
          J[c] = a / fk_regular(A[c * cols + c]);
          x[r] += J[c] * (told[pair * w_to + at[c]] - expected[c]);
          for (int t = 0; t < r_to; t++) columns[r * wide + t] += J[c] * told_root[(pair * w_to + at[c]) * r_to + t];
        }
        for (int c = given; c < cols; c++) columns[r * wide + r_to + c - given] = cross[c];
        for (int c = r_to + cols - given; c < wide; c++) columns[r * wide + c] = 0.0;
      }
      fk_triangular(columns, wide, nu, wide, nu);
      for (int r = 0; r < nu; r++) memcpy(left + r * nu, columns + r * wide, nu * sizeof(double));
      fk_mix_in(nu, p + i, mean + (size_t)i * nu, root + (size_t)i * nu * nu, joint[pair], x, left);
    }
}

/* Right singular vectors, the rows of V (n, n), and singular values of W (n, n), which is lost: Jacobi's rotations. */
FK_STATIC void fk_singular(int n, double *W, double *V, double *values) {
  for (int r = 0; r < n * n; r++) V[r] = r % (n + 1) == 0;
  for (int sweep = 0, again = 1; again && sweep < 60; sweep++) {
    again = 0;
    for (int a = 0; a < n; a++)
      for (int b = a + 1; b < n; b++) {
        double aa = 0.0, bb = 0.0, ab = 0.0;
        for (int r = 0; r < n; r++) {
          aa += W[r * n + a] * W[r * n + a];
          bb += W[r * n + b] * W[r * n + b];
          ab += W[r * n + a] * W[r * n + b];
        }
        if (!(fabs(ab) > 1e-16 * sqrt(aa) * sqrt(bb))) continue;
        again = 1;
        const double z = (bb - aa) / (2.0 * ab), t = (z < 0.0 ? -1.0 : 1.0) / (fabs(z) + hypot(1.0, z));
        const double c = 1.0 / sqrt(1.0 + t * t), s = c * t;
        for (int r = 0; r < n; r++) {
          const double x = W[r * n + a], y = W[r * n + b], v = V[a * n + r], u = V[b * n + r];
          W[r * n + a] = c * x - s * y, W[r * n + b] = s * x + c * y;
          V[a * n + r] = c * v - s * u, V[b * n + r] = s * v + c * u;
        }
      }
  }
  for (int c = 0; c < n; c++) {
    double sum = 0.0;
    for (int r = 0; r < n; r++) sum += W[r * n + c] * W[r * n + c];
    values[c] = sqrt(sum);
  }
}

/* Condition a law with this root (n, n) on Y u + noise of unit variance: W (2 n, 2 n) becomes [A 0; B left]. */
FK_STATIC void fk_observe(int n, const double *Y, const double *root, double *W) {
  memset(W, 0, (size_t)4 * n * n * sizeof(double));
  for (int r = 0; r < n; r++) {
    W[r * 2 * n + r] = 1.0;
    for (int c = 0; c < n; c++) {
      for (int t = c; t < n; t++) W[r * 2 * n + n + c] += Y[r * n + t] * root[t * n + c];
      W[(n + r) * 2 * n + n + c] = root[r * n + c];
    }
  }
  fk_triangular(W, 2 * n, 2 * n, 2 * n, 2 * n);
}

/* Tell the n branches of a node what is known of it: its smoothed probability and window, ms and Ls, against what the
 * filter knew, mf and Lf.  Of the branches p, mean and root are filled in, which are `next` branches apart. */
FK_STATIC void fk_tell_apart(const fk_gaps *k, int nu, const double *rows, int n, int i, double gamma, const double *mf,
                             const double *Lf, const double *ms, const double *Ls, double *p, double *mean, double *root) {
  const int M1 = k->M1, e = nu + k->m, ld = fk_padded(M1), wide = 2 * nu;
  double W[4 * FK_GAPS_LARGEST * FK_GAPS_LARGEST], V[FK_GAPS_LARGEST * FK_GAPS_LARGEST], T[FK_GAPS_LARGEST * FK_GAPS_LARGEST];
  double Y[FK_GAPS_LARGEST * FK_GAPS_LARGEST], R[FK_GAPS_LARGEST * FK_GAPS_LARGEST];
  double tau[FK_GAPS_LARGEST], told[FK_GAPS_LARGEST], off[FK_GAPS_LARGEST], white[FK_GAPS_LARGEST], pull[FK_GAPS_LARGEST];
  for (int c = 0; c < nu; c++) /* Lf^-1 Ls */
    for (int r = 0; r < nu; r++) {
      double a = Ls[r * nu + c];
      for (int t = 0; t < r; t++) a -= Lf[r * nu + t] * W[t * nu + c];
      W[r * nu + c] = a / fk_regular(Lf[r * nu + r]);
    }
  fk_singular(nu, W, V, told);
  for (int r = 0; r < nu; r++) {
    told[r] = fmax(1.0 - told[r] * told[r], 0.0); /* mixtures may widen what one class can only narrow */
    tau[r] = 0.0;
    for (int c = nu - 1; c >= 0; c--) { /* T Ls = V */
      double a = V[r * nu + c];
      for (int t = c + 1; t < nu; t++) a -= T[r * nu + t] * Ls[t * nu + c];
      T[r * nu + c] = a / fk_regular(Ls[c * nu + c]);
    }
    for (int c = 0; c < nu; c++) tau[r] += T[r * nu + c] * (ms[c] - mf[c]);
  }
  double top = -DBL_MAX, total = 0.0;
  for (int b = 0; b < n; b++) {
    const size_t to = (size_t)b * M1 + i;
    const double *mu = FK_STATE(rows, e, b, 1, ld) + i, *L = FK_STATE(rows, e, b, 1 + e, ld) + i;
    double l = *(FK_STATE(rows, e, b, 0, ld) + i);
    for (int r = 0; r < nu; r++) {
      off[r] = mu[(size_t)r * ld] - mf[r];
      for (int c = 0; c < nu; c++) {
        R[r * nu + c] = L[(size_t)(r * e + c) * ld];
        Y[r * nu + c] = told[r] >= 1.0 - FK_TELLING ? sqrt(told[r]) * T[r * nu + c] : 0.0;
      }
    }
    fk_observe(nu, Y, R, W);
    for (int r = 0; r < nu; r++) {
      double a = told[r] >= 1.0 - FK_TELLING ? -tau[r] / sqrt(told[r]) : 0.0;
      for (int c = 0; c < nu; c++) a += Y[r * nu + c] * off[c];
      for (int t = 0; t < r; t++) a -= W[r * wide + t] * white[t];
      white[r] = a / W[r * wide + r];
      l -= 0.5 * white[r] * white[r] + log(W[r * wide + r]);
    }
    for (int r = 0; r < nu; r++) {
      for (int t = 0; t < nu; t++) off[r] -= W[(nu + r) * wide + t] * white[t];
      for (int c = 0; c < nu; c++) {
        R[r * nu + c] = W[(nu + r) * wide + nu + c];
        Y[r * nu + c] = told[r] >= 1.0 - FK_TELLING ? 0.0 : sqrt(told[r]) * T[r * nu + c];
      }
    }
    fk_observe(nu, Y, R, W);
    for (int r = 0; r < nu; r++) { /* in `white`, what pulls in direction r of T */
      double t = 0.0;
      white[r] = 0.0;
      l -= log(W[r * wide + r]);
      if (told[r] >= 1.0 - FK_TELLING) continue;
      for (int c = 0; c < nu; c++) t += T[r * nu + c] * off[c];
      white[r] = tau[r] - told[r] * t;
      l += tau[r] * t - 0.5 * told[r] * t * t;
    }
    for (int c = 0; c < nu; c++) {
      pull[c] = 0.0;
      for (int r = 0; r < nu; r++)
        for (int t = 0; t < nu; t++) pull[c] += W[(nu + r) * wide + nu + c] * T[t * nu + r] * white[t];
      l += 0.5 * pull[c] * pull[c];
    }
    for (int r = 0; r < nu; r++) {
      double a = mf[r] + off[r];
      for (int c = 0; c < nu; c++) {
        root[(to * nu + r) * nu + c] = W[(nu + r) * wide + nu + c];
        a += W[(nu + r) * wide + nu + c] * pull[c];
      }
      mean[to * nu + r] = a;
    }
    p[to] = l;
    top = fmax(top, l);
  }
  for (int b = 0; b < n; b++) total += exp(p[(size_t)b * M1 + i] - top);
  for (int b = 0; b < n; b++) p[(size_t)b * M1 + i] = exp(p[(size_t)b * M1 + i] - top) / total * gamma;
}

/* Moments of X given the nodes, from the regression of X on u in each branch and the smoothed moments of u: mu (M1),
 * x (M1, m), P (M1, m, m). */
FK_STATIC void fk_smoothed(const fk_gaps *k, int nu, const double *rows, int n, const double *p, const double *mean,
                           const double *root, double *mu, double *x, double *P, double *scratch) {
  const int M1 = k->M1, m = k->m, e = nu + m, ld = fk_padded(M1), size = m + m * m;
  double B[FK_GAPS_LARGEST], columns[FK_GAPS_LARGEST * FK_BACK_LARGEST];
  for (int i = 0; i < M1; i++) {
    int likeliest = 0;
    mu[i] = 0.0;
    for (int b = 0; b < n; b++) {
      const size_t of = (size_t)b * M1 + i;
      const double *at = FK_STATE(rows, e, b, 1, ld) + i, *T = FK_STATE(rows, e, b, 1 + e, ld) + i;
      double *to = scratch + (size_t)b * size;
      mu[i] += p[of];
      if (p[of] > p[(size_t)likeliest * M1 + i]) likeliest = b;
      for (int r = 0; r < m; r++) {
        to[r] = at[(size_t)(nu + r) * ld];
        for (int c = 0; c < nu; c++) columns[r * e + c] = 0.0;
        for (int c = nu - 1; c >= 0; c--) { /* B T_uu = T_xu */
          double a = T[(size_t)((nu + r) * e + c) * ld];
          for (int t = c + 1; t < nu; t++) a -= B[t] * T[(size_t)(t * e + c) * ld];
          B[c] = a / fk_regular(T[(size_t)(c * e + c) * ld]);
          to[r] += B[c] * (mean[of * nu + c] - at[(size_t)c * ld]);
          for (int t = 0; t < nu; t++) columns[r * e + t] += B[c] * root[(of * nu + c) * nu + t];
        }
        for (int c = 0; c < m; c++) columns[r * e + nu + c] = T[(size_t)((nu + r) * e + nu + c) * ld];
      }
      for (int r = 0; r < m; r++)
        for (int c = 0; c < m; c++) {
          double a = 0.0;
          for (int t = 0; t < e; t++) a += columns[r * e + t] * columns[c * e + t];
          to[m + r * m + c] = a;
        }
    }
    const double *first = scratch + (size_t)likeliest * size;
    for (int r = 0; r < m; r++) x[i * m + r] = 0.0;
    for (int r = 0; r < m * m; r++) P[(size_t)i * m * m + r] = 0.0;
    for (int b = 0; b < n; b++) { /* what is impossible keeps any finite moments */
      const double share = mu[i] > 0.0 ? p[(size_t)b * M1 + i] / mu[i] : 1.0 / n, *of = scratch + (size_t)b * size;
      for (int r = 0; r < m; r++) x[i * m + r] += share * (of[r] - first[r]);
    }
    for (int r = 0; r < m; r++) x[i * m + r] += first[r];
    for (int b = 0; b < n; b++) {
      const double share = mu[i] > 0.0 ? p[(size_t)b * M1 + i] / mu[i] : 1.0 / n, *of = scratch + (size_t)b * size;
      for (int r = 0; r < m; r++)
        for (int c = 0; c < m; c++)
          P[((size_t)i * m + r) * m + c] += share * (of[m + r * m + c] + (of[r] - x[i * m + r]) * (of[c] - x[i * m + c]));
    }
  }
}

#undef FK_STATE
#endif
