/* Banks of Kalman filters that switch: mixing before the prediction, weighing after the update.
 *
 * `modes` filters of one size; i is the mode before, j the one now.  All weights are logarithms.
 */
#ifndef FUZZYKF_IMM_H
#define FUZZYKF_IMM_H

#include "kalman.h"

typedef struct {
  int modes;
  fk_kalman **f;
  double *log_mu;                /* of the modes after the latest update */
  const double *log_M;           /* (modes, modes) */
  double *log_cbar, *omega;      /* predicted weights; P(i | j) */
  double *log_likelihood, total; /* of the modes, and of the mixture */
  double *weights;               /* room for the weights of a mixture */
  double x[FK_KALMAN_LARGEST], P[FK_KALMAN_SQUARE];
  double x_prior[FK_KALMAN_LARGEST], P_prior[FK_KALMAN_SQUARE];
} fk_bank;

typedef struct {
  double *x, *P, *x_prior, *P_prior, *mu, *log_likelihood;
} fk_bank_output;

/* Number of doubles behind the pointers of a bank that are its own. */
FK_STATIC size_t fk_bank_size(size_t modes) { return modes * (modes + 4); }

FK_STATIC void fk_bank_place(fk_bank *b, double *room) {
  const size_t K = b->modes;
  b->log_mu = room, b->log_cbar = room + K, b->log_likelihood = room + 2 * K, b->weights = room + 3 * K;
  b->omega = room + 4 * K;
}

/* log_cbar and omega; a mode that cannot be reached keeps to itself */
FK_STATIC void fk_bank_weights(fk_bank *b) {
  const int K = b->modes;
  for (int j = 0; j < K; j++) {
    double top = -INFINITY, sum = 0.0;
    for (int i = 0; i < K; i++) {
      b->omega[i * K + j] = b->log_mu[i] + b->log_M[i * K + j];
      if (b->omega[i * K + j] > top) top = b->omega[i * K + j];
    }
    b->log_cbar[j] = -INFINITY;
    if (top == -INFINITY) {
      for (int i = 0; i < K; i++) b->omega[i * K + j] = i == j ? 1.0 : 0.0;
      continue;
    }
    for (int i = 0; i < K; i++) sum += b->omega[i * K + j] = exp(b->omega[i * K + j] - top);
    for (int i = 0; i < K; i++) b->omega[i * K + j] /= sum;
    b->log_cbar[j] = top + log(sum);
  }
}

/* Moments of a mixture, w with the given stride: of the predictions, or of the estimates. */
FK_STATIC void fk_bank_merge(const fk_bank *b, const double *w, int stride, int of_prior, double *x, double *P) {
  const int n = b->f[0]->n;
  double d[FK_KALMAN_LARGEST], off[FK_KALMAN_LARGEST] = {0};
  int top = 0; /* means as differences from the likeliest: those that agree then do so to the last bit */
  for (int k = 1; k < b->modes; k++) top = w[k * stride] > w[top * stride] ? k : top;
  const double *first = of_prior ? b->f[top]->x_prior : b->f[top]->x;
  const double *first_P = of_prior ? b->f[top]->P_prior : b->f[top]->P;
  double sum[FK_KALMAN_SQUARE] = {0};
  for (int k = 0; k < b->modes; k++) {
    const double *from = of_prior ? b->f[k]->x_prior : b->f[k]->x;
    for (int r = 0; r < n; r++) off[r] += w[k * stride] * (from[r] - first[r]);
  }
  for (int k = 0; k < b->modes; k++) {
    const double *from = of_prior ? b->f[k]->x_prior : b->f[k]->x;
    const double *within = of_prior ? b->f[k]->P_prior : b->f[k]->P, weight = w[k * stride];
    for (int r = 0; r < n; r++) d[r] = from[r] - first[r] - off[r];
    for (int r = 0; r < n; r++)
      for (int c = 0; c < n; c++)
        sum[r * n + c] += weight * (within[r * n + c] - first_P[r * n + c] + d[r] * d[c]);
  }
  for (int r = 0; r < n; r++) x[r] = first[r] + off[r];
  for (int r = 0; r < n * n; r++) P[r] = first_P[r] + sum[r];
}

/* Mix the estimates and predict; x_prior and P_prior of the mixture are by the predicted weights. */
FK_STATIC void fk_bank_predict(const fk_kalman_engine *engine, fk_bank *b) {
  const size_t n = b->f[0]->n;
  fk_bank_weights(b);
  for (int j = 0; j < b->modes; j++)
    fk_bank_merge(b, b->omega + j, b->modes, 0, b->f[j]->x_prior, b->f[j]->P_prior);
  for (int j = 0; j < b->modes; j++) {
    memcpy(b->f[j]->x, b->f[j]->x_prior, n * sizeof(double));
    memcpy(b->f[j]->P, b->f[j]->P_prior, n * n * sizeof(double));
    engine->predict(b->f[j]);
  }
  for (int j = 0; j < b->modes; j++) b->weights[j] = exp(b->log_cbar[j]);
  fk_bank_merge(b, b->weights, 1, 1, b->x_prior, b->P_prior);
}

/* Bayes' rule for the modes, and the moments of the mixture; 0 if none is possible.  Differences of
 * log-likelihoods come first: those of an outlier would round the predicted weights away. */
FK_STATIC int fk_bank_weigh(fk_bank *b) {
  double best = -INFINITY, top = -INFINITY, sum = 0.0;
  for (int j = 0; j < b->modes; j++)
    if (b->log_cbar[j] > -INFINITY && b->log_likelihood[j] > best) best = b->log_likelihood[j];
  if (!(best > -INFINITY && best < INFINITY)) return 0;
  for (int j = 0; j < b->modes; j++) {
    b->log_mu[j] = b->log_cbar[j] + (b->log_likelihood[j] - best);
    if (b->log_mu[j] > top) top = b->log_mu[j];
  }
  if (!(top > -INFINITY && top < INFINITY)) return 0;
  for (int j = 0; j < b->modes; j++) sum += exp(b->log_mu[j] - top);
  top += log(sum);
  b->total = best + top;
  for (int j = 0; j < b->modes; j++) b->weights[j] = exp(b->log_mu[j] -= top);
  fk_bank_merge(b, b->weights, 1, 0, b->x, b->P);
  return 1;
}

/* Update every mode, then the weights; 0 where S is not positive definite, or no mode is possible. */
FK_STATIC int fk_bank_update(const fk_kalman_engine *engine, fk_bank *b, const double *z) {
  for (int j = 0; j < b->modes; j++) {
    if (!engine->update(b->f[j], z)) return 0;
    b->log_likelihood[j] = fk_kalman_log_likelihood(b->f[j]);
  }
  return fk_bank_weigh(b);
}

/* An observation of which nothing was seen: the predicted weights and estimates remain. */
FK_STATIC void fk_bank_skip(fk_bank *b) {
  const size_t n = b->f[0]->n;
  for (int j = 0; j < b->modes; j++) {
    memcpy(b->f[j]->x, b->f[j]->x_prior, n * sizeof(double));
    memcpy(b->f[j]->P, b->f[j]->P_prior, n * n * sizeof(double));
    b->log_likelihood[j] = 0.0;
    b->weights[j] = exp(b->log_mu[j] = b->log_cbar[j]);
  }
  fk_bank_merge(b, b->weights, 1, 0, b->x, b->P);
  b->total = 0.0;
}

/* Along n_steps observations; returns the number of steps done, fewer where one is refused. */
FK_STATIC size_t fk_bank_filter(const fk_kalman_engine *engine, fk_bank *b, const double *z, size_t n_steps,
                                const fk_bank_output *out) {
  const size_t n = b->f[0]->n, nn = n * n, K = b->modes;
  const int m = b->f[0]->m;
  for (size_t t = 0; t < n_steps; t++, z += m) {
    int seen = 0;
    for (int i = 0; i < m; i++) seen += !isnan(z[i]);
    fk_bank_predict(engine, b);
    if (!seen) fk_bank_skip(b);
    else if (!fk_bank_update(engine, b, z)) return t;
    if (out->x) memcpy(out->x + t * n, b->x, n * sizeof(double));
    if (out->P) memcpy(out->P + t * nn, b->P, nn * sizeof(double));
    if (out->x_prior) memcpy(out->x_prior + t * n, b->x_prior, n * sizeof(double));
    if (out->P_prior) memcpy(out->P_prior + t * nn, b->P_prior, nn * sizeof(double));
    if (out->mu) memcpy(out->mu + t * K, b->weights, K * sizeof(double));
    if (out->log_likelihood) out->log_likelihood[t] = b->total;
  }
  return n_steps;
}

#endif
