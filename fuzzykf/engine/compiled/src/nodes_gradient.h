/* One step back of the gradient of the log-likelihood of IMM; see fuzzykf/engine/numpy/nodes_gradient.py.
 *
 * Unlike in the steps forward, a node stands by itself here: its state, and the derivatives by that, are the
 * 1 + m + m m numbers log p, x and P, one node after another.  Matrices are stored by rows, covariances whole.
 */
#ifndef FUZZYKF_NODES_GRADIENT_H
#define FUZZYKF_NODES_GRADIENT_H

#include "nodes.h"

/* Parameters of one step of one node, and the derivatives by them. */
typedef struct {
  const double *F, *b, *Q, *H, *d, *R;
} fk_node;
typedef struct {
  double *F, *b, *Q, *H, *d, *R;
} fk_node_slope;

/* Of a step: the components seen, the states before and after it, the probabilities that they hold, and the
 * derivatives by them; those by the logarithms of transitions are summed up. */
typedef struct {
  int n_seen, seen[FK_NODES_LARGEST];
  const double *y, *before, *after, *p_before, *p_after;
  double *g_before, *g_after, *g_log_T;
  double *scratch; /* 2 M numbers */
} fk_node_step;

FK_INLINE size_t fk_node_size(int m) { return 1 + (size_t)m + (size_t)m * m; }

/* Shares of the nodes i in what leads to node j, and its moments; 0 if nothing does. */
FK_INLINE int fk_node_mix(const fk_nodes *k, const int m, const fk_node_step *s, int j, double *share, double *x,
                          double *P) {
  const int M = k->M;
  const size_t ld = fk_padded(M), size = fk_node_size(m);
  double sum = 0.0, top = -DBL_MAX, off[FK_NODES_LARGEST];
  int best = 0;
  for (int r = 0; r < m; r++) x[r] = 0.0;
  for (int r = 0; r < m * m; r++) P[r] = 0.0;
  for (int i = 0; i < M; i++) sum += share[i] = s->p_before[i] * k->transition[i * ld + j];
  if (!(sum > FK_TINY)) { /* relative to the best pair */
    for (int i = 0; i < M; i++) {
      share[i] = s->before[i * size] + k->log_transition[i * ld + j];
      top = share[i] > top ? share[i] : top;
    }
    if (!(top > FK_DEAD)) return 0;
    sum = 0.0;
    for (int i = 0; i < M; i++) sum += share[i] = exp(share[i] - top);
  }
  for (int i = 0; i < M; i++) {
    share[i] /= sum;
    best = share[i] > share[best] ? i : best;
  }
  /* from the likeliest on: what all have in common then cancels to the last bit, however large */
  const double *centre = s->before + best * size + 1;
  for (int i = 0; i < M; i++)
    for (int r = 0; r < m && share[i] != 0.0; r++) x[r] += share[i] * (s->before[i * size + 1 + r] - centre[r]);
  for (int r = 0; r < m; r++) x[r] += centre[r];
  for (int i = 0; i < M; i++) {
    const double *one = s->before + i * size + 1;
    if (share[i] == 0.0) continue;
    for (int r = 0; r < m; r++) off[r] = one[r] - x[r];
    for (int r = 0; r < m; r++)
      for (int c = 0; c < m; c++) P[r * m + c] += share[i] * (one[m + r * m + c] + off[r] * off[c]);
  }
  return 1;
}

/* From derivatives g by the merged moments x of node j, and by the log of its weight, to those by what is merged. */
FK_INLINE void fk_node_mix_back(const int M, const int m, const fk_node_step *s, int j, const double *share,
                                const double *x, const double *g, double *value) {
  const size_t size = fk_node_size(m);
  double mean = 0.0, off[FK_NODES_LARGEST];
  for (int i = 0; i < M; i++) {
    const double *one = s->before + i * size + 1;
    double *to = s->g_before + i * size + 1, sum = 0.0;
    if (share[i] == 0.0) continue;
    for (int r = 0; r < m; r++) off[r] = one[r] - x[r];
    for (int r = 0; r < m * m; r++) {
      to[m + r] += share[i] * g[1 + m + r];
      sum += g[1 + m + r] * one[m + r];
    }
    for (int r = 0; r < m; r++) {
      double turned = 0.0;
      for (int c = 0; c < m; c++) turned += g[1 + m + r * m + c] * off[c];
      to[r] += share[i] * (g[1 + r] + 2.0 * turned);
      sum += (g[1 + r] + turned) * off[r];
    }
    value[i] = sum;
    mean += share[i] * sum;
  }
  /* by the log of a share, less what all of them have in common, as they sum to one */
  for (int i = 0; i < M; i++) {
    if (share[i] == 0.0) continue;
    const double by_log_w = share[i] * (value[i] - mean + g[0]);
    s->g_before[i * size] += by_log_w;
    s->g_log_T[(size_t)i * M + j] += by_log_w;
  }
}

/* x1 = F x + b and P1 = F P F' + Q, with F P. */
FK_INLINE void fk_node_move(const int m, const fk_node *k, const double *x, const double *P, double *x1, double *P1,
                            double *FP) {
  for (int r = 0; r < m; r++) {
    x1[r] = k->b[r];
    for (int c = 0; c < m; c++) {
      double sum = 0.0;
      for (int t = 0; t < m; t++) sum += k->F[r * m + t] * P[t * m + c];
      FP[r * m + c] = sum;
      x1[r] += k->F[r * m + c] * x[c];
    }
  }
  for (int r = 0; r < m; r++)
    for (int c = r; c < m; c++) {
      double sum = k->Q[r * m + c];
      for (int t = 0; t < m; t++) sum += FP[r * m + t] * k->F[c * m + t];
      P1[r * m + c] = P1[c * m + r] = sum;
    }
}

/* From derivatives g by the moments of a node after a move to those before it, x and P, and to F, b and Q. */
FK_INLINE void fk_node_move_back(const int m, const double *F, const double *x, const double *FP, double *g,
                                 const fk_node_slope *to) {
  double gx[FK_NODES_LARGEST], gP[FK_NODES_SQUARE], GF[FK_NODES_SQUARE], by_F[FK_NODES_SQUARE];
  memcpy(gx, g + 1, m * sizeof(double));
  memcpy(gP, g + 1 + m, m * m * sizeof(double));
  for (int r = 0; r < m; r++)
    for (int c = 0; c < m; c++) {
      double twice = 0.0, sum = 0.0;
      for (int t = 0; t < m; t++) {
        twice += gP[r * m + t] * FP[t * m + c];
        sum += gP[r * m + t] * F[t * m + c];
      }
      by_F[r * m + c] = gx[r] * x[c] + 2.0 * twice;
      GF[r * m + c] = sum;
    }
  for (int r = 0; r < m; r++) {
    double sum = 0.0;
    for (int t = 0; t < m; t++) sum += F[t * m + r] * gx[t];
    g[1 + r] = sum;
    for (int c = r; c < m; c++) {
      sum = 0.0;
      for (int t = 0; t < m; t++) sum += F[t * m + r] * GF[t * m + c];
      g[1 + m + r * m + c] = g[1 + m + c * m + r] = sum;
    }
  }
  for (int r = 0; r < m; r++) to->b[r] += gx[r];
  for (int r = 0; r < m * m; r++) to->F[r] += by_F[r];
  for (int r = 0; r < m * m; r++) to->Q[r] += gP[r];
}

/* The inverse of the covariance S = H P H' + R of the n components seen, from W = H P (n, m). */
FK_INLINE void fk_node_precision(const int m, const int q, const int n, const int *seen, const fk_node *k,
                                 const double *W, double *precision) {
  double L[FK_NODES_SQUARE], D[FK_NODES_LARGEST], root[FK_NODES_SQUARE]; /* S = L D L', and L^-1 */
  for (int a = 0; a < n; a++) {
    for (int e = 0; e <= a; e++) {
      double S = k->R[seen[a] * q + seen[e]];
      for (int r = 0; r < m; r++) S += k->H[seen[a] * m + r] * W[e * m + r];
      for (int t = 0; t < e; t++) S -= L[a * n + t] * L[e * n + t] * D[t];
      if (e < a) L[a * n + e] = S / D[e];
      else D[a] = S;
    }
    for (int e = 0; e < n; e++) {
      double sum = e == a ? 1.0 : 0.0;
      for (int t = e; t < a; t++) sum -= L[a * n + t] * root[t * n + e];
      root[a * n + e] = sum;
    }
  }
  for (int a = 0; a < n; a++)
    for (int e = a; e < n; e++) {
      double sum = 0.0;
      for (int t = e; t < n; t++) sum += root[t * n + a] * root[t * n + e] / D[t];
      precision[a * n + e] = precision[e * n + a] = sum;
    }
}

/* From derivatives g by what is known of a node after an observation to those by x and P before it, and to H, d
 * and R. */
FK_INLINE void fk_node_update_back(const int m, const int q, const int n, const fk_node_step *s, const fk_node *k,
                                   const double *x, const double *P, const double *after, double *g,
                                   const fk_node_slope *to) {
  const int *seen = s->seen;
  const double by_l = g[0], *gx = g + 1, *gP = g + 1 + m, *P_after = after + 1 + m;
  double v[FK_NODES_LARGEST], w[FK_NODES_LARGEST], seen_x[FK_NODES_LARGEST], by_d[FK_NODES_LARGEST];
  double near_x[FK_NODES_LARGEST], h[FK_NODES_LARGEST], moved[FK_NODES_LARGEST];
  double W[FK_NODES_SQUARE], precision[FK_NODES_SQUARE], fit[FK_NODES_SQUARE], fit_H[FK_NODES_SQUARE];
  double gain[FK_NODES_SQUARE], turned[FK_NODES_SQUARE]; /* K' and K' times the derivatives by P, (n, m) */
  double A[FK_NODES_SQUARE], G[FK_NODES_SQUARE];
  for (int a = 0; a < n; a++) {
    const double *H = k->H + seen[a] * m;
    v[a] = s->y[seen[a]] - k->d[seen[a]];
    for (int r = 0; r < m; r++) v[a] -= H[r] * x[r];
    for (int c = 0; c < m; c++) {
      double sum = 0.0;
      for (int r = 0; r < m; r++) sum += H[r] * P[r * m + c];
      W[a * m + c] = sum;
    }
  }
  fk_node_precision(m, q, n, seen, k, W, precision);
  for (int r = 0; r < m; r++) {
    h[r] = moved[r] = 0.0;
    for (int c = 0; c < m; c++) {
      A[r * m + c] = r == c ? 1.0 : 0.0;
      moved[r] += P_after[r * m + c] * gx[c];
    }
  }
  for (int a = 0; a < n; a++) {
    const double *H = k->H + seen[a] * m;
    w[a] = seen_x[a] = 0.0;
    for (int e = 0; e < n; e++) w[a] += precision[a * n + e] * v[e];
    for (int c = 0; c < m; c++) {
      double sum = 0.0;
      for (int e = 0; e < n; e++) sum += precision[a * n + e] * W[e * m + c];
      gain[a * m + c] = sum;
      seen_x[a] += sum * gx[c];
      h[c] += H[c] * w[a];
      turned[a * m + c] = 0.0;
    }
    for (int r = 0; r < m; r++)
      for (int c = 0; c < m; c++) {
        A[r * m + c] -= gain[a * m + r] * H[c];
        turned[a * m + c] += gain[a * m + r] * gP[r * m + c];
      }
    by_d[a] = by_l * w[a] - seen_x[a];
  }
  for (int a = 0; a < n; a++) {
    double *H = to->H + seen[a] * m, *R = to->R + seen[a] * q;
    to->d[seen[a]] += by_d[a];
    for (int c = 0; c < m; c++) {
      double sum = 0.0;
      for (int r = 0; r < m; r++) sum += turned[a * m + r] * P_after[r * m + c];
      H[c] += by_d[a] * after[1 + c] + w[a] * moved[c] - 2.0 * sum - by_l * gain[a * m + c];
      fit_H[a * m + c] = 0.0;
    }
    for (int e = 0; e < n; e++) fit[a * n + e] = 0.5 * by_l * (w[a] * w[e] - precision[a * n + e]);
    for (int e = a; e < n; e++) {
      double sum = fit[a * n + e] - 0.5 * (seen_x[a] * w[e] + w[a] * seen_x[e]);
      for (int c = 0; c < m; c++) sum += turned[a * m + c] * gain[e * m + c];
      R[seen[e]] += sum;
      if (e > a) to->R[seen[e] * q + seen[a]] += sum;
    }
    for (int e = 0; e < n; e++)
      for (int c = 0; c < m; c++) fit_H[a * m + c] += fit[a * n + e] * k->H[seen[e] * m + c];
  }
  for (int r = 0; r < m; r++) {
    near_x[r] = 0.0;
    for (int t = 0; t < m; t++) near_x[r] += A[t * m + r] * gx[t];
    for (int c = 0; c < m; c++) {
      double sum = 0.0;
      for (int t = 0; t < m; t++) sum += gP[r * m + t] * A[t * m + c];
      G[r * m + c] = sum;
    }
  }
  for (int r = 0; r < m; r++) {
    g[1 + r] = near_x[r] + by_l * h[r];
    for (int c = r; c < m; c++) {
      double sum = 0.5 * (near_x[r] * h[c] + h[r] * near_x[c]);
      for (int t = 0; t < m; t++) sum += A[t * m + r] * G[t * m + c];
      for (int a = 0; a < n; a++) sum += k->H[seen[a] * m + r] * fit_H[a * m + c];
      g[1 + m + r * m + c] = g[1 + m + c * m + r] = sum;
    }
  }
}

/* The parameters of node j, and the derivatives by them. */
FK_INLINE fk_node fk_node_of(const fk_node *k, int m, int q, int j) {
  return (fk_node){k->F + (size_t)j * m * m, k->b + (size_t)j * m, k->Q + (size_t)j * m * m,
                   k->H + (size_t)j * q * m, k->d + (size_t)j * q, k->R + (size_t)j * q * q};
}
FK_INLINE fk_node_slope fk_node_slope_of(const fk_node_slope *k, int m, int q, int j) {
  return (fk_node_slope){k->F + (size_t)j * m * m, k->b + (size_t)j * m, k->Q + (size_t)j * m * m,
                         k->H + (size_t)j * q * m, k->d + (size_t)j * q, k->R + (size_t)j * q * q};
}

/* From derivatives by log p of nodes given an observation to those by the sums of the logs of its density and of p
 * before it; what is not seen has no part in the log-likelihood. */
FK_INLINE void fk_node_weigh_back(const int M, const size_t size, const fk_node_step *s) {
  double rest = s->n_seen ? 1.0 : 0.0;
  for (int j = 0; j < M; j++) rest -= s->g_after[j * size];
  for (int j = 0; j < M; j++) s->g_after[j * size] += s->p_after[j] * rest;
}

/* Go one step back, of m and q states and components: from g_after, which is used up, to g_before. */
FK_INLINE void fk_node_step_back_sized(const fk_nodes *k, const int m, const int q, const fk_node *nodes,
                                       const fk_node_slope *slopes, const fk_node_step *s) {
  const int M = k->M;
  const size_t size = fk_node_size(m);
  double *share = s->scratch, *value = s->scratch + M;
  double x[FK_NODES_LARGEST], P[FK_NODES_SQUARE], FP[FK_NODES_SQUARE], x1[FK_NODES_LARGEST], P1[FK_NODES_SQUARE];
  fk_node_weigh_back(M, size, s);
  memset(s->g_before, 0, M * size * sizeof(double));
  for (int j = 0; j < M; j++) {
    const fk_node node = fk_node_of(nodes, m, q, j);
    const fk_node_slope slope = fk_node_slope_of(slopes, m, q, j);
    const double *after = s->after + j * size;
    double *g = s->g_after + j * size;
    /* what cannot be has no part in anything */
    if (!(after[0] > FK_DEAD) || !fk_node_mix(k, m, s, j, share, x, P)) continue;
    fk_node_move(m, &node, x, P, x1, P1, FP);
    if (s->n_seen) fk_node_update_back(m, q, s->n_seen, s, &node, x1, P1, after, g, &slope);
    fk_node_move_back(m, node.F, x, FP, g, &slope);
    fk_node_mix_back(M, m, s, j, share, x, g, value);
  }
}

/* Sizes that are constant let the loops of the usual systems unroll. */
FK_STATIC void fk_node_step_back(const fk_nodes *k, const fk_node *nodes, const fk_node_slope *slopes,
                                 const fk_node_step *s) {
#define FK_SIZE(m, q) case 100 * m + q: fk_node_step_back_sized(k, m, q, nodes, slopes, s); return;
  switch (100 * k->m + k->q) {
    FK_SIZE(1, 1) FK_SIZE(2, 1) FK_SIZE(2, 2) FK_SIZE(3, 1) FK_SIZE(4, 1) FK_SIZE(4, 2)
    default: fk_node_step_back_sized(k, k->m, k->q, nodes, slopes, s);
  }
#undef FK_SIZE
}

/* Go back from the first observation, in place: to the derivatives by the law of the first node and of X_1, which
 * `before` holds. */
FK_STATIC void fk_node_begin_back(const fk_nodes *k, const fk_node *nodes, const fk_node_slope *slopes,
                                  const fk_node_step *s) {
  const int m = k->m, q = k->q;
  const size_t size = fk_node_size(m);
  fk_node_weigh_back(k->M, size, s);
  for (int j = 0; j < k->M && s->n_seen; j++) {
    const fk_node node = fk_node_of(nodes, m, q, j);
    const fk_node_slope slope = fk_node_slope_of(slopes, m, q, j);
    const double *x = s->before + j * size + 1, *after = s->after + j * size;
    if (after[0] > FK_DEAD)
      fk_node_update_back(m, q, s->n_seen, s, &node, x, x + m, after, s->g_after + j * size, &slope);
  }
}

#endif
