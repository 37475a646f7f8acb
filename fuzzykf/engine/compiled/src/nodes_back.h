/* What the nodes at a later time tell of the state before, for the way back; see numpy/nodes_backward.py. */
#ifndef FUZZYKF_NODES_BACK_H
#define FUZZYKF_NODES_BACK_H

#include "nodes.h"

/* Where something is divided by such a variance, so much more is lost. */
#define FK_NODES_DIVISOR (16.0 * FK_NODES_CERTAIN)
/* A variance that is no larger part of another is as large but for rounding. */
#define FK_NODES_ALIKE (1.0 + 1e-6)
/* A variance that is a smaller part of what it was before an observation is rounding error. */
#define FK_NODES_SEEN 1e-24
/* Columns whose cosine is smaller are at right angles; rounds of rotations. */
#define FK_NODES_STRAIGHT DBL_EPSILON
#define FK_NODES_SWEEPS 30

/* Of one node: the root of its noise, the observation in parts whose noises are independent, and the factor by
 * which all later observations tell of the state there, in parts likewise. */
typedef struct {
  double root[FK_NODES_SQUARE];                                           /* of Q, (m, m) */
  double H[FK_NODES_SQUARE], y[FK_NODES_LARGEST], D[FK_NODES_LARGEST];    /* n rows */
  double rows[FK_NODES_SQUARE], centre[FK_NODES_LARGEST];                 /* m rows: z = rows (x - centre) */
  double v[FK_NODES_LARGEST], e[FK_NODES_LARGEST];
} fk_later;

/* S = L D L' of (m, m), L with ones in the diagonal; pivots that are rounding error, or not above `least`, are 0. */
FK_STATIC void fk_ldl(int m, const double *S, double certain, const double *least, double *L, double *D) {
  for (int a = 0; a < m; a++) {
    double pivot = S[a * m + a], floor = certain * m * pivot;
    if (least && least[a] > floor) floor = least[a];
    for (int t = 0; t < m; t++) L[a * m + t] = a == t;
    for (int t = 0; t < a; t++) {
      double sum = S[a * m + t];
      for (int s = 0; s < t; s++) sum -= L[a * m + s] * L[t * m + s] * D[s];
      L[a * m + t] = D[t] > 0.0 ? sum / D[t] : 0.0;
      pivot -= L[a * m + t] * L[a * m + t] * D[t];
    }
    D[a] = pivot > floor ? pivot : 0.0;
  }
}

/* X = L^-1 X, (m, n). */
FK_STATIC void fk_forward(int m, int n, const double *L, double *X) {
  for (int a = 1; a < m; a++)
    for (int t = 0; t < a; t++)
      for (int c = 0; c < n; c++) X[a * n + c] -= L[a * m + t] * X[t * n + c];
}

/* Axes V and variances e of the covariance L D L': rotations of one side, by which small ones keep their digits. */
FK_STATIC void fk_axes(int m, const double *L, const double *D, double *V, double *e) {
  double G[FK_NODES_SQUARE]; /* the root's columns in rows, turned until they are at right angles */
  int turned = 1;
  for (int c = 0; c < m; c++)
    for (int r = 0; r < m; r++) G[c * m + r] = L[c * m + r] * sqrt(D[r]), V[c * m + r] = c == r;
  for (int sweep = 0; turned && sweep < FK_NODES_SWEEPS; sweep++) {
    turned = 0;
    for (int p = 0; p < m - 1; p++)
      for (int q = p + 1; q < m; q++) {
        double a = 0.0, b = 0.0, g = 0.0;
        for (int r = 0; r < m; r++)
          a += G[p * m + r] * G[p * m + r], b += G[q * m + r] * G[q * m + r], g += G[p * m + r] * G[q * m + r];
        if (!(fabs(g) > FK_NODES_STRAIGHT * sqrt(a * b))) continue;
        turned = 1;
        const double zeta = (b - a) / (2.0 * g), t = copysign(1.0, zeta) / (fabs(zeta) + hypot(1.0, zeta));
        const double cosine = 1.0 / hypot(1.0, t), sine = cosine * t;
        for (int r = 0; r < m; r++) {
          const double g0 = G[p * m + r], g1 = G[q * m + r], v0 = V[p * m + r], v1 = V[q * m + r];
          G[p * m + r] = cosine * g0 - sine * g1, G[q * m + r] = sine * g0 + cosine * g1;
          V[p * m + r] = cosine * v0 - sine * v1, V[q * m + r] = sine * v0 + cosine * v1;
        }
      }
  }
  for (int a = 0; a < m; a++) {
    e[a] = 0.0;
    for (int r = 0; r < m; r++) e[a] += G[a * m + r] * G[a * m + r];
  }
}

/* What is seen of an observation at node j, n components of it. */
FK_STATIC void fk_later_seen(const fk_nodes *k, int j, int n, const int *seen, const double *y, fk_later *to) {
  const int m = k->m, q = k->q;
  const size_t ld = fk_padded(k->M);
  double noise[FK_NODES_SQUARE] = {0.0}, L[FK_NODES_SQUARE];
  for (int a = 0; a < n; a++) {
    for (int c = 0; c < n; c++) noise[a * n + c] = k->R[(size_t)(seen[a] * q + seen[c]) * ld + j];
    for (int c = 0; c < m; c++) to->H[a * m + c] = k->H[(size_t)(seen[a] * m + c) * ld + j];
    to->y[a] = y[seen[a]] - k->d[(size_t)seen[a] * ld + j];
  }
  fk_ldl(n, noise, FK_NODES_CERTAIN, NULL, L, to->D);
  fk_forward(n, m, L, to->H);
  fk_forward(n, 1, L, to->y);
}

/* The smoothed law at node j over the filtered one; of what takes information away nothing where histories meet. */
FK_STATIC void fk_later_told(const fk_nodes *k, int j, const double *size, int met, const double *filtered,
                             const double *smoothed, fk_later *to) {
  const int m = k->m;
  const size_t ld = fk_padded(k->M);
  double S[FK_NODES_SQUARE], L[FK_NODES_SQUARE], W[FK_NODES_SQUARE], V[FK_NODES_SQUARE], D[FK_NODES_LARGEST];
  double least[FK_NODES_LARGEST], off[FK_NODES_LARGEST];
  for (int r = 0; r < m; r++) {
    to->centre[r] = filtered[(size_t)(1 + r) * ld + j];
    off[r] = smoothed[(size_t)(1 + r) * ld + j] - to->centre[r];
    least[r] = FK_NODES_SEEN * size[r];
  }
  for (int r = 0; r < m * m; r++) S[r] = filtered[(size_t)(1 + m + r) * ld + j], W[r] = r % (m + 1) == 0;
  fk_ldl(m, S, FK_NODES_DIVISOR, least, L, D);
  fk_forward(m, m, L, W);
  for (int a = 0; a < m; a++)
    for (int c = 0; c < m; c++) W[a * m + c] *= D[a] > 0.0 ? 1.0 / sqrt(D[a]) : 0.0;
  for (int a = 0; a < m; a++) /* W Ps W', and one of what is certain */
    for (int c = 0; c < m; c++) {
      double sum = 0.0;
      for (int s = 0; s < m; s++) sum += W[a * m + s] * smoothed[(size_t)(1 + m + s * m + c) * ld + j];
      V[a * m + c] = sum;
    }
  for (int a = 0; a < m; a++)
    for (int c = 0; c < m; c++) {
      double sum = a == c && !(D[a] > 0.0);
      for (int s = 0; s < m; s++) sum += V[a * m + s] * W[c * m + s];
      S[a * m + c] = sum;
    }
  fk_ldl(m, S, FK_NODES_CERTAIN, NULL, L, D);
  fk_axes(m, L, D, V, to->e);
  for (int a = 0; a < m; a++) {
    to->v[a] = 0.0;
    if (met && to->e[a] > 1.0) to->e[a] = 1.0;
    for (int c = 0; c < m; c++) {
      double sum = 0.0;
      for (int s = 0; s < m; s++) sum += V[a * m + s] * W[s * m + c];
      to->rows[a * m + c] = sum;
      to->v[a] += sum * off[c];
    }
  }
}

/* All that is used of node j, which the nodes with a logarithm of probability in `log_p` may lead to. */
FK_STATIC void fk_later_at(const fk_nodes *k, int j, const double *table, const double *y, const double *filtered,
                           const double *smoothed, fk_later *to) {
  const int m = k->m;
  const size_t ld = fk_padded(k->M);
  int seen[FK_NODES_LARGEST], histories = 0;
  double S[FK_NODES_SQUARE], L[FK_NODES_SQUARE], D[FK_NODES_LARGEST], size[FK_NODES_LARGEST];
  for (int r = 0; r < m * m; r++) S[r] = k->Q[(size_t)r * ld + j];
  fk_ldl(m, S, FK_NODES_CERTAIN, NULL, L, D);
  for (int r = 0; r < m; r++) {
    size[r] = S[r * m + r];
    for (int c = 0; c < m; c++) to->root[r * m + c] = L[r * m + c] * sqrt(D[c]);
  }
  for (int i = 0; i < k->M; i++) {
    if (!(k->log_into[j * ld + i] > FK_DEAD)) continue;
    histories += table[i] > FK_DEAD;
    for (int r = 0; r < m; r++) {
      double deviation = 0.0;
      for (int t = 0; t < m; t++)
        deviation += fabs(k->F[(size_t)(r * m + t) * ld + j]) * sqrt(table[(size_t)(1 + m + t * m + t) * ld + i]);
      deviation = deviation * deviation + S[r * m + r];
      if (deviation > size[r]) size[r] = deviation;
    }
  }
  const int n = fk_nodes_seen(k->q, y, seen);
  if (n) fk_later_seen(k, j, n, seen, y, to);
  fk_later_told(k, j, size, histories > 1, filtered, smoothed, to);
}

#endif
