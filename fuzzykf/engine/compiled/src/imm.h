/* Banks of Kalman filters that switch: mixing before the prediction (IMM), or one filter for each pair of
 * modes and merging after the update (GPB2).
 *
 * `modes` filters of one size; i is the mode before, j the one now.  All weights are logarithms.
 */
#ifndef FUZZYKF_IMM_H
#define FUZZYKF_IMM_H

#include "kalman.h"

/* What became of an observation: S is not positive definite, or no mode gives it a density. */
enum { FK_BANK_SINGULAR = 0, FK_BANK_UPDATED = 1, FK_BANK_IMPOSSIBLE = -1 };

/* Mean and covariance of one part of a mixture, where they are kept. */
typedef struct {
  double *x, *P;
} fk_moments;

typedef struct {
  int modes, every_pair; /* GPB2, which needs more room */
  fk_kalman **f;
  double *log_mu;                /* of the modes after the latest update */
  const double *log_M;           /* (modes, modes) */
  double *log_cbar, *omega;      /* predicted weights; P(i | j) */
  double *log_likelihood, total; /* of the modes, and of the mixture */
  double *own;                   /* log-likelihoods of the filters; in GPB2, of the likeliest pairs */
  double *weights;               /* room for the weights of a mixture */
  fk_moments *now, *prior;       /* of the filters: x and P, x_prior and P_prior */
  fk_moments *pairs, *merged;    /* GPB2: of all that end in one mode; the estimates to come */
  double *log_joint;             /* GPB2: of the pairs (i, j) */
  double *log_pair, *pair_log_likelihood, *within, *best; /* GPB2: one column of pairs; what columns add up to */
  double x[FK_KALMAN_LARGEST], P[FK_KALMAN_SQUARE];
  double x_prior[FK_KALMAN_LARGEST], P_prior[FK_KALMAN_SQUARE];
} fk_bank;

typedef struct {
  double *x, *P, *x_prior, *P_prior, *mu, *log_likelihood;
} fk_bank_output;

/* Number of doubles behind the pointers of a bank that are its own; moments are two pointers. */
FK_STATIC size_t fk_bank_size(size_t modes, size_t n, int every_pair) {
  const size_t both = 2 * sizeof(fk_moments) / sizeof(double);
  const size_t size = modes * (modes + 5 + both);
  return every_pair ? size + modes * (modes + 4 + both + 2 * (n + n * n)) : size;
}

/* Give a bank its room: modes, every_pair and the filters are known, with n states each. */
FK_STATIC void fk_bank_place(fk_bank *b, int n, double *room) {
  const size_t K = b->modes, both = 2 * sizeof(fk_moments) / sizeof(double);
  b->now = (fk_moments *)room, b->prior = b->now + K;
  room += K * both;
  b->log_mu = room, b->log_cbar = room + K, b->log_likelihood = room + 2 * K, b->own = room + 3 * K;
  b->weights = room + 4 * K, b->omega = room + 5 * K;
  for (size_t k = 0; k < K; k++) {
    b->now[k] = (fk_moments){b->f[k]->x, b->f[k]->P};
    b->prior[k] = (fk_moments){b->f[k]->x_prior, b->f[k]->P_prior};
  }
  if (!b->every_pair) return;
  room += K * (K + 5);
  b->pairs = (fk_moments *)room, b->merged = b->pairs + K;
  room += K * both;
  b->log_pair = room, b->pair_log_likelihood = room + K, b->within = room + 2 * K, b->best = room + 3 * K;
  b->log_joint = room + 4 * K;
  room += 4 * K + K * K;
  for (size_t k = 0; k < 2 * K; k++, room += n + n * n) b->pairs[k] = (fk_moments){room, room + n};
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

/* Moments of a mixture of K parts of n states, w with the given stride. */
FK_STATIC void fk_merge(int K, int n, const double *w, int stride, const fk_moments *of, double *x, double *P) {
  double d[FK_KALMAN_LARGEST], off[FK_KALMAN_LARGEST] = {0};
  int top = 0; /* means as differences from the likeliest: those that agree then do so to the last bit */
  for (int k = 1; k < K; k++) top = w[k * stride] > w[top * stride] ? k : top;
  const double *first = of[top].x, *first_P = of[top].P;
  double sum[FK_KALMAN_SQUARE] = {0};
  for (int k = 0; k < K; k++)
    for (int r = 0; r < n; r++) off[r] += w[k * stride] * (of[k].x[r] - first[r]);
  for (int k = 0; k < K; k++) {
    const double *from = of[k].x, *within = of[k].P, weight = w[k * stride];
    for (int r = 0; r < n; r++) d[r] = from[r] - first[r] - off[r];
    for (int r = 0; r < n; r++)
      for (int c = 0; c < n; c++)
        sum[r * n + c] += weight * (within[r * n + c] - first_P[r * n + c] + d[r] * d[c]);
  }
  for (int r = 0; r < n; r++) x[r] = first[r] + off[r];
  for (int r = 0; r < n * n; r++) P[r] = first_P[r] + sum[r];
}

FK_STATIC void fk_copy(int n, const double *x, const double *P, double *to_x, double *to_P) {
  memcpy(to_x, x, n * sizeof(double));
  memcpy(to_P, P, (size_t)n * n * sizeof(double));
}

/* The mixture of the predictions, by the predicted weights. */
FK_STATIC void fk_bank_merge_prior(fk_bank *b) {
  for (int j = 0; j < b->modes; j++) b->weights[j] = exp(b->log_cbar[j]);
  fk_merge(b->modes, b->f[0]->n, b->weights, 1, b->prior, b->x_prior, b->P_prior);
}

/* Mix the estimates and predict (IMM). */
FK_STATIC void fk_bank_predict(const fk_kalman_engine *engine, fk_bank *b) {
  const int K = b->modes, n = b->f[0]->n;
  fk_bank_weights(b);
  for (int j = 0; j < K; j++) fk_merge(K, n, b->omega + j, K, b->now, b->f[j]->x_prior, b->f[j]->P_prior);
  for (int j = 0; j < K; j++) {
    fk_copy(n, b->f[j]->x_prior, b->f[j]->P_prior, b->f[j]->x, b->f[j]->P);
    engine->predict(b->f[j]);
  }
  fk_bank_merge_prior(b);
}

/* Bayes' rule for K hypotheses: their log-weights and weights; best + within is the log of the normaliser.
 * 0 if none is possible; then log_w and w are not to be used.  Differences of log-likelihoods come first:
 * those of an outlier would round the prior weights away. */
FK_STATIC int fk_weigh(int K, const double *log_prior, const double *log_likelihood, double *log_w, double *w,
                       double *best, double *within) {
  double top = -INFINITY, sum = 0.0, most = -INFINITY;
  for (int j = 0; j < K; j++)
    if (log_prior[j] > -INFINITY && log_likelihood[j] > most) most = log_likelihood[j];
  if (!(most > -INFINITY && most < INFINITY)) return 0;
  for (int j = 0; j < K; j++) {
    log_w[j] = log_prior[j] + (log_likelihood[j] - most);
    if (log_w[j] > top) top = log_w[j];
  }
  if (!(top > -INFINITY && top < INFINITY)) return 0;
  for (int j = 0; j < K; j++) sum += exp(log_w[j] - top);
  top += log(sum);
  for (int j = 0; j < K; j++) w[j] = exp(log_w[j] -= top);
  *best = most, *within = top;
  return 1;
}

/* Weigh the modes, and merge their estimates. */
FK_STATIC int fk_bank_weigh(fk_bank *b, const double *log_prior, const double *log_likelihood) {
  double best, within;
  if (!fk_weigh(b->modes, log_prior, log_likelihood, b->log_mu, b->weights, &best, &within))
    return FK_BANK_IMPOSSIBLE;
  b->total = best + within;
  fk_merge(b->modes, b->f[0]->n, b->weights, 1, b->now, b->x, b->P);
  return FK_BANK_UPDATED;
}

/* Update every mode, then the weights. */
FK_STATIC int fk_bank_update(const fk_kalman_engine *engine, fk_bank *b, const double *z) {
  for (int j = 0; j < b->modes; j++) {
    if (!engine->update(b->f[j], z)) return FK_BANK_SINGULAR;
    b->own[j] = b->log_likelihood[j] = fk_kalman_log_likelihood(b->f[j]);
  }
  return fk_bank_weigh(b, b->log_cbar, b->log_likelihood);
}

/* Weights of the pairs, and what they say of the modes (GPB2). */
FK_STATIC void fk_pairs_weights(fk_bank *b) {
  const int K = b->modes;
  for (int i = 0; i < K; i++)
    for (int j = 0; j < K; j++) b->log_joint[i * K + j] = b->log_mu[i] + b->log_M[i * K + j];
  fk_bank_weights(b);
}

/* A filter with the system of f, and no estimate yet. */
FK_STATIC void fk_stand_in(const fk_kalman *f, fk_kalman *pair) {
  pair->n = f->n, pair->m = f->m, pair->n_seen = 0, pair->alpha_sq = f->alpha_sq;
  pair->F = f->F, pair->Q = f->Q, pair->H = f->H, pair->R = f->R;
}

/* Predict with filter j from every mode, and merge: x_prior and P_prior of j (GPB2). */
FK_STATIC void fk_pairs_predict(const fk_kalman_engine *engine, fk_bank *b, int j, fk_kalman *pair) {
  const int K = b->modes, n = b->f[j]->n;
  for (int i = 0; i < K; i++) {
    fk_copy(n, b->f[i]->x, b->f[i]->P, pair->x, pair->P);
    engine->predict(pair);
    fk_copy(n, pair->x_prior, pair->P_prior, b->pairs[i].x, b->pairs[i].P);
  }
  fk_merge(K, n, b->omega + j, K, b->pairs, b->f[j]->x_prior, b->f[j]->P_prior);
}

/* What a filter tells of an observation is what its likeliest pair does. */
FK_STATIC void fk_take_innovation(fk_kalman *f, const fk_kalman *pair) {
  const size_t n = f->n, m = f->m, seen = f->n_seen = pair->n_seen;
  memcpy(f->y, pair->y, m * sizeof(double));
  memcpy(f->S, pair->S, m * m * sizeof(double));
  memcpy(f->K, pair->K, n * m * sizeof(double));
  memcpy(f->L, pair->L, seen * seen * sizeof(double));
  memcpy(f->D, pair->D, seen * sizeof(double));
  memcpy(f->seen, pair->seen, seen * sizeof(int));
}

/* Update the pairs that end in mode j, weigh them against each other, and merge: merged[j], and within[j] and
 * best[j], whose sum is the log-density of j and z.  A mode that cannot be reached keeps to itself. */
FK_STATIC int fk_pairs_update(const fk_kalman_engine *engine, fk_bank *b, int j, fk_kalman *pair,
                              const double *z) {
  const int K = b->modes, n = b->f[j]->n;
  double *l = b->pair_log_likelihood, *log_w = b->log_pair;
  for (int i = 0; i < K; i++) log_w[i] = b->log_joint[i * K + j];
  for (int turn = 0, first = j; turn < K; turn++) {
    const int i = turn == 0 ? j : turn - (turn <= j); /* j, then the others in their order */
    fk_copy(n, b->pairs[i].x, b->pairs[i].P, pair->x_prior, pair->P_prior);
    if (!engine->update(pair, z)) return 0;
    fk_copy(n, pair->x, pair->P, b->pairs[i].x, b->pairs[i].P);
    l[i] = fk_kalman_log_likelihood(pair);
    const double ahead = (log_w[i] - log_w[first]) + (l[i] - l[first]);
    if (turn == 0 || ahead > 0.0 || (ahead == 0.0 && i < first)) {
      first = i;
      b->own[j] = l[i];
      fk_take_innovation(b->f[j], pair);
    }
  }
  if (!fk_weigh(K, log_w, l, log_w, b->weights, b->best + j, b->within + j)) {
    for (int i = 0; i < K; i++) b->weights[i] = i == j ? 1.0 : 0.0;
    b->best[j] = 0.0, b->within[j] = -INFINITY;
  }
  fk_merge(K, n, b->weights, 1, b->pairs, b->merged[j].x, b->merged[j].P);
  return 1;
}

/* Bayes' rule for the modes in which the pairs have ended. */
FK_STATIC int fk_pairs_weigh(fk_bank *b) {
  const int K = b->modes, n = b->f[0]->n;
  for (int j = 0; j < K; j++) {
    fk_copy(n, b->merged[j].x, b->merged[j].P, b->f[j]->x, b->f[j]->P);
    b->log_likelihood[j] = b->within[j] > -INFINITY ? b->within[j] + b->best[j] - b->log_cbar[j] : -INFINITY;
  }
  return fk_bank_weigh(b, b->within, b->best);
}

/* Predict every pair, and keep the moments of all: xs (modes, modes, n) and Ps (modes, modes, n, n). */
FK_STATIC void fk_pairs_predict_all(const fk_kalman_engine *engine, fk_bank *b, double *xs, double *Ps) {
  const int K = b->modes, n = b->f[0]->n;
  fk_kalman pair;
  fk_pairs_weights(b);
  for (int j = 0; j < K; j++) {
    fk_stand_in(b->f[j], &pair);
    fk_pairs_predict(engine, b, j, &pair);
    for (size_t i = 0, at = j; i < (size_t)K; i++, at += K)
      fk_copy(n, b->pairs[i].x, b->pairs[i].P, xs + at * n, Ps + at * n * n);
  }
  fk_bank_merge_prior(b);
}

/* Update the pairs that were kept; log_joint and log_cbar are those of the prediction. */
FK_STATIC int fk_pairs_update_all(const fk_kalman_engine *engine, fk_bank *b, const double *xs, const double *Ps,
                                  const double *z) {
  const int K = b->modes, n = b->f[0]->n;
  fk_kalman pair;
  for (int j = 0; j < K; j++) {
    fk_stand_in(b->f[j], &pair);
    for (size_t i = 0, at = j; i < (size_t)K; i++, at += K)
      fk_copy(n, xs + at * n, Ps + at * n * n, b->pairs[i].x, b->pairs[i].P);
    if (!fk_pairs_update(engine, b, j, &pair, z)) return FK_BANK_SINGULAR;
  }
  return fk_pairs_weigh(b);
}

/* An observation of which nothing was seen: the predicted weights and estimates remain. */
FK_STATIC void fk_bank_skip(fk_bank *b) {
  const int n = b->f[0]->n;
  for (int j = 0; j < b->modes; j++) {
    fk_copy(n, b->f[j]->x_prior, b->f[j]->P_prior, b->f[j]->x, b->f[j]->P);
    b->own[j] = b->log_likelihood[j] = 0.0;
    b->weights[j] = exp(b->log_mu[j] = b->log_cbar[j]);
  }
  fk_merge(b->modes, n, b->weights, 1, b->now, b->x, b->P);
  b->total = 0.0;
}

/* Predict, then update with z, of which something was seen; z is NULL where nothing was. */
FK_STATIC int fk_bank_step(const fk_kalman_engine *engine, fk_bank *b, const double *z) {
  if (b->every_pair) {
    fk_kalman pair;
    fk_pairs_weights(b);
    for (int j = 0; j < b->modes; j++) {
      fk_stand_in(b->f[j], &pair);
      fk_pairs_predict(engine, b, j, &pair);
      if (z && !fk_pairs_update(engine, b, j, &pair, z)) return FK_BANK_SINGULAR;
    }
    fk_bank_merge_prior(b);
    if (z) return fk_pairs_weigh(b);
  } else {
    fk_bank_predict(engine, b);
    if (z) return fk_bank_update(engine, b, z);
  }
  fk_bank_skip(b);
  return FK_BANK_UPDATED;
}

/* What is stored from a step on. */
FK_STATIC fk_bank_output fk_bank_output_from(const fk_bank *b, const fk_bank_output *out, size_t step) {
  const size_t n = b->f[0]->n, x = step * n, P = x * n;
  return (fk_bank_output){out->x ? out->x + x : NULL,
                          out->P ? out->P + P : NULL,
                          out->x_prior ? out->x_prior + x : NULL,
                          out->P_prior ? out->P_prior + P : NULL,
                          out->mu ? out->mu + step * b->modes : NULL,
                          out->log_likelihood ? out->log_likelihood + step : NULL};
}

/* NaN for so many steps. */
FK_STATIC void fk_bank_output_blank(const fk_bank *b, const fk_bank_output *out, size_t steps) {
  const size_t n = b->f[0]->n;
  double *const fields[] = {out->x, out->P, out->x_prior, out->P_prior, out->mu, out->log_likelihood};
  const size_t sizes[] = {n, n * n, n, n * n, b->modes, 1};
  for (int k = 0; k < 6; k++)
    if (fields[k])
      for (size_t i = 0; i < steps * sizes[k]; i++) fields[k][i] = NAN;
}

/* Along n_steps observations; returns the number of steps done, fewer where one is refused: `became` says why. */
FK_STATIC size_t fk_bank_filter(const fk_kalman_engine *engine, fk_bank *b, const double *z, size_t n_steps,
                                const fk_bank_output *out, int *became) {
  const size_t n = b->f[0]->n, nn = n * n, K = b->modes;
  const int m = b->f[0]->m;
  *became = FK_BANK_UPDATED;
  for (size_t t = 0; t < n_steps; t++, z += m) {
    int seen = 0;
    for (int i = 0; i < m; i++) seen += !isnan(z[i]);
    *became = fk_bank_step(engine, b, seen ? z : NULL);
    if (*became != FK_BANK_UPDATED) return t;
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
