/* The state of a filter and its way along a series. */
#ifndef FUZZYKF_SERIES_H
#define FUZZYKF_SERIES_H

#include "switching.h"

/* What is known of the nodes; `linear` says that the first row holds probabilities, not their
 * logarithms.  `total` is the likelihood of the latest observation, or its logarithm. */
typedef struct {
  double *table, *sign;
  int linear, log_known;
  double total;
} fk_state;

FK_INLINE double fk_log_likelihood(const fk_state *s) { return s->log_known ? s->total : log(s->total); }

/* Bring a state to logarithms. */
FK_STATIC void fk_to_logs(fk_state *s, int M) {
  if (!s->linear) return;
  for (int i = 0; i < M; i++) s->table[i] = s->table[i] > 0.0 ? log(s->table[i]) : FK_LOG_ZERO;
  s->linear = 0;
}

/* Probabilities of the nodes, in `p` unless the state holds them. */
FK_STATIC const double *fk_probabilities(const fk_engine *e, const fk_state *s, int M, double *p) {
  if (s->linear) return s->table;
  e->exp_row(s->table, M, p);
  if (s->sign)
    for (int i = 0; i < M; i++) p[i] *= s->sign[i];
  for (int i = M; i < fk_padded(M); i++) p[i] = 0.0;
  return p;
}

/* Move a state to the next observation.  The old one keeps its meaning, though perhaps in
 * logarithms afterwards. */
FK_STATIC void fk_advance(const fk_engine *e, const fk_kernel *k, fk_state *from, fk_state *to, const double *u,
                       double *scratch) {
  if (k->is_scalar) {
    if (!from->linear) {
      double *p = scratch; /* of padded M1 numbers */
      if (e->exp_row(from->table, k->M1, p) > FK_TINY) {
        for (int i = 0; i < fk_padded(k->M1); i++) from->table[i] = i < k->M1 ? p[i] : 0.0;
        from->linear = 1;
      }
    }
    if (from->linear && e->step_scalar(k, from->table, u[1], u[2], to->table, &to->total, scratch)) {
      to->linear = 1, to->log_known = 0;
      return;
    }
  }
  fk_to_logs(from, k->M1);
  to->total = e->step(k, from->table, from->sign, u, to->table, k->is_signed ? to->sign : NULL, scratch);
  to->linear = 0, to->log_known = 1;
}

/* Where the summaries of a series go; any of them may be NULL. */
typedef struct {
  double *x, *P, *x_prior, *P_prior, *mu, *modes, *means, *log_likelihood;
} fk_output;

/* Write what is known after observation n; x and P are temporaries of m and m m numbers. */
FK_STATIC void fk_summarise(const fk_engine *e, const fk_summary *s, const fk_state *state, int M, int m, size_t n,
                         const fk_output *out, double *p, double *x) {
  const double *mu = fk_probabilities(e, state, M, p);
  if (out->log_likelihood) out->log_likelihood[n] = fk_log_likelihood(state);
  if (out->mu) memcpy(out->mu + n * M, mu, M * sizeof(double));
  if (out->modes) out->modes[n] = fk_most_likely(s, mu, M);
  if (out->means) {
    double mean = 0.0;
    for (int j = 0; j < M; j++) mean += mu[j] * s->nodes[j];
    out->means[n] = mean;
  }
  if (out->x || out->P)
    e->posterior(M, m, mu, state->table, out->x ? out->x + n * m : x, out->P ? out->P + n * m * m : NULL);
}

/* Filter n observations from the state `now` on, summarising each; rows u = (1, w, y').  The two
 * states change places; returns 1 if the last one is in `other`. */
FK_STATIC int fk_filter(const fk_engine *e, const fk_kernel *k, const fk_summary *s, fk_state *now, fk_state *other,
                     const double *U, size_t n, const fk_output *out, size_t first, double *p, double *x,
                     double *scratch) {
  const int width = 1 + k->w + k->q, m = k->m;
  const int priors = out->x_prior || out->P_prior;
  fk_state *one = now, *two = other;
  for (size_t t = 0; t < n; t++) {
    const double *u = U + t * width;
    if (priors) {
      const double *mu = fk_probabilities(e, one, k->M1, p);
      e->prior(k, s, mu, one->table, u, out->x_prior ? out->x_prior + (first + t) * m : x,
               out->P_prior ? out->P_prior + (first + t) * m * m : x + m, scratch);
    }
    fk_advance(e, k, one, two, u, scratch);
    fk_summarise(e, s, two, k->M2, m, first + t, out, p, x);
    fk_state *swap = one;
    one = two, two = swap;
  }
  return one != now;
}

#endif
