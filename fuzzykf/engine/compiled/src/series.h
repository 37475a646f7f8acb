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

/* Let a state go on with probabilities, if they were kept and none is too small for them. */
FK_STATIC void fk_load_mass(fk_state *s, const double *mass, int M) {
  for (int i = 0; i < M; i++)
    if (!(mass[i] > FK_TINY)) return;
  memcpy(s->table, mass, M * sizeof(double));
  memset(s->table + M, 0, (fk_padded(M) - M) * sizeof(double));
  s->linear = 1;
}

/* The probabilities, NaN where a state has their logarithms alone. */
FK_STATIC void fk_store_mass(double *mass, const fk_state *s, int M) {
  for (int i = 0; i < M; i++) mass[i] = s->linear ? s->table[i] : NAN;
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

/* Room for temporaries along a series: M numbers, m + m m, a row u, what a step needs, and for scalar
 * systems the states and the pair weights of fk_chunk steps. */
typedef struct {
  double *p, *x, *u, *scratch, *tables, *weights;
} fk_room;

/* How many steps to take at once: the weights of their pairs stay in the cache. */
#define FK_CHUNK 32
FK_INLINE int fk_chunk(const fk_kernel *k) {
  const int steps = 2048 / (fk_slots(k) * FK_LANES);
  return steps > FK_CHUNK ? FK_CHUNK : (steps < 2 ? 2 : steps);
}
FK_INLINE size_t fk_chunk_tables(const fk_kernel *k) { return 3 * (size_t)(fk_chunk(k) + 1) * fk_padded(k->M2); }
FK_INLINE size_t fk_chunk_weights(const fk_kernel *k) {
  return (size_t)FK_LANES * k->M1 + (size_t)fk_chunk(k) * fk_slots(k) * FK_LANES;
}

/* Keep the state after observation n. */
FK_STATIC void fk_keep(const fk_state *state, int M, int m, size_t n, const fk_output *out) {
  const int rows = 1 + m + m * m, ld = fk_padded(M);
  if (out->sign) memcpy(out->sign + n * M, state->sign, M * sizeof(double));
  if (!out->table) return;
  double *to = out->table + n * rows * M;
  for (int i = 0; i < M; i++) {
    const double p = state->table[i];
    to[i] = !state->linear ? p : p > 0.0 ? log(p) : FK_LOG_ZERO;
  }
  for (int r = 1; r < rows; r++) memcpy(to + r * M, state->table + r * ld, M * sizeof(double));
}

/* Write what is known after observation n. */
FK_STATIC void fk_summarise(const fk_engine *e, const fk_summary *s, const fk_state *state, int M, int m, size_t n,
                            const fk_output *out, const fk_room *room) {
  const double *mu = fk_probabilities(e, state, M, room->p);
  fk_keep(state, M, m, n, out);
  if (out->log_likelihood) out->log_likelihood[n] = fk_log_likelihood(state);
  if (out->mu) memcpy(out->mu + n * M, mu, M * sizeof(double));
  if (out->modes) out->modes[n] = fk_most_likely(s, mu); /* MPM */
  if (out->means) {
    double mean = 0.0;
    for (int j = 0; j < M; j++) mean += mu[j] * s->nodes[j];
    out->means[n] = mean;
  }
  if (out->x || out->P)
    e->posterior(M, m, mu, state->table, out->x ? out->x + n * m : room->x, out->P ? out->P + n * m * m : NULL);
}

/* Filter the observation after y[0], q numbers each, from the state `now` on to `other`; the window
 * before it ends in y[0]. */
FK_STATIC void fk_filter_one(const fk_engine *e, const fk_kernel *k, const fk_summary *s, fk_state *now,
                             fk_state *other, const double *y, const fk_output *out, size_t n, const fk_room *room) {
  const int m = k->m, q = k->q;
  room->u[0] = 1.0;
  for (int lag = 0; lag < k->w / q; lag++) memcpy(room->u + 1 + lag * q, y - lag * q, q * sizeof(double));
  memcpy(room->u + 1 + k->w, y + q, q * sizeof(double));
  if (out->x_prior || out->P_prior) {
    double *x = out->x_prior ? out->x_prior + n * m : room->x, *P = out->P_prior ? out->P_prior + n * m * m : room->x + m;
    const double *mu = fk_probabilities(e, now, k->M1, room->p);
    e->prior(k, s, mu, now->table, room->u, x, P, room->scratch);
  }
  fk_advance(e, k, now, other, room->u, room->scratch);
  fk_summarise(e, s, other, k->M2, m, n, out, room);
}

/* As many steps as can be taken at once for a scalar system, at most n; the last two states go to
 * `now` and `other`, the latest to `now`. */
FK_STATIC int fk_filter_chunk(const fk_engine *e, const fk_kernel *k, const fk_summary *s, fk_state *now,
                              fk_state *other, const double *y, int n, const fk_output *out, size_t first,
                              const fk_room *room) {
  const int M = k->M1;
  const size_t size = 3 * (size_t)fk_padded(M);
  double totals[FK_CHUNK];
  memcpy(room->tables, now->table, size * sizeof(double));
  const int done = e->run_scalar(k, y, n, room->tables, totals, room->weights);
  if (!done) return 0;
  e->summarise_scalar(s, M, y, done, room->tables, totals, first, out);
  for (int t = 0; out->table && t < done; t++) {
    const fk_state kept = {room->tables + (size_t)(t + 1) * size, NULL, 1, 0, totals[t]};
    fk_keep(&kept, M, 1, first + t, out);
  }
  fk_state *states[2] = {other, now};
  for (int t = 0; t < 2; t++) {
    memcpy(states[t]->table, room->tables + (size_t)(done - 1 + t) * size, size * sizeof(double));
    states[t]->linear = 1;
  }
  if (done > 1) other->log_known = 0, other->total = totals[done - 2];
  now->log_known = 0, now->total = totals[done - 1];
  return done;
}

/* Filter n observations after y[0] from the state `now` on, summarising each.  The two states change
 * places; returns 1 if the last one is in `other`. */
FK_STATIC int fk_filter(const fk_engine *e, const fk_kernel *k, const fk_summary *s, fk_state *now, fk_state *other,
                        const double *y, size_t n, const fk_output *out, size_t first, const fk_room *room) {
  const size_t chunk = fk_chunk(k);
  fk_state *one = now, *two = other;
  for (size_t t = 0; t < n;) {
    if (k->is_scalar && one->linear) {
      const int most = n - t < chunk ? (int)(n - t) : (int)chunk;
      const int done = fk_filter_chunk(e, k, s, one, two, y + t, most, out, first + t, room);
      t += done;
      if (done == most) continue;
    }
    fk_filter_one(e, k, s, one, two, y + t * k->q, out, first + t, room);
    t++;
    fk_state *swap = one;
    one = two, two = swap;
  }
  return one != now;
}

#endif
