/* One linear filter along many series: as many of them as a vector has lanes side by side.
 *
 * The covariances do not depend on what is observed, only on which components are.  So complete series
 * share the gains, which are found once for all of them (fk_gains).  From the first gap on a series has
 * covariances of its own, a lane of vectors as all the rest.  Which way a series goes, and so every bit
 * of what is found for it, depends on nothing but the series.
 */
#ifndef FUZZYKF_KALMAN_LANES_H
#define FUZZYKF_KALMAN_LANES_H

#include "kalman.h"

/* The filter; matrices move on by their strides at each step, which are zero where all steps share one. */
typedef struct {
  int n, m;
  const double *F, *Q, *H, *R;
  size_t F_stride, Q_stride, H_stride, R_stride;
  double alpha_sq;
} fk_linear;

/* Covariances of complete series at the steps of a chunk, and what follows from them. */
typedef struct {
  double *P, *P_prior, *K, *L, *D;
  double *constant; /* of -2 log likelihood */
  int known;        /* how many steps; none after one at which S is not positive definite */
} fk_gains;

/* A chunk of FK_LANES series: entry e of step t is row t * size + e, of FK_LANES numbers.  What is not
 * wanted of x_prior, u and log_likelihood is NULL; the covariances have a stride of zero then. */
typedef struct {
  double *z, *u, *x, *P, *x_prior, *P_prior, *log_likelihood;
  double *x_state, *P_state; /* before the chunk, then after it */
  size_t P_stride, P_prior_stride;
} fk_lanes_room;

/* One version of the arithmetic per kind of processor, from step `first` of the series on.
 *
 * shared: complete series; apart: any, returns the number of steps done, fewer where some S is not
 * positive definite. */
typedef struct {
  void (*shared)(const fk_linear *, const fk_gains *, size_t first, int steps, const fk_lanes_room *);
  int (*apart)(const fk_linear *, size_t first, int steps, const fk_lanes_room *);
} fk_lanes_engine;

/* What is stored of every step, as far as it is not NULL: floats if `is_single`, else doubles. */
typedef struct {
  void *x, *P, *x_prior, *P_prior, *log_likelihood;
  int is_single;
} fk_many_output;

/* The work: series (count, n_steps, m), controls (1 or count, n_steps, n), the latter with the stride 0 where
 * all series share them. */
typedef struct {
  fk_linear model;
  const double *z, *u, *x, *P;
  size_t count, n_steps, u_stride;
  fk_many_output out;
} fk_many;

/* How many steps to take at once: what is found at them stays in the cache. */
FK_INLINE int fk_many_chunk(const fk_linear *model) {
  const int steps = 512 / (model->n * model->n);
  return steps < 8 ? 8 : steps > 128 ? 128 : steps;
}

/* How many doubles the work needs: gains, a chunk of lanes, the state of each series. */
FK_INLINE size_t fk_many_room(const fk_linear *model, size_t count) {
  const size_t n = model->n, m = model->m, T = fk_many_chunk(model);
  return T * (2 * n * n + n * m + m * m + m + 1) + FK_LANES * (T * (m + 3 * n + 2 * n * n + 1) + n + n * n) +
         count * (n + n * n);
}

/* Numbers from ``from``, ``stride`` apart, to place ``at`` of an output. */
FK_INLINE void fk_emit(const double *from, size_t stride, size_t count, void *to, size_t at, int is_single) {
  if (is_single) {
    float *values = (float *)to + at;
    for (size_t k = 0; k < count; k++) values[k] = (float)from[k * stride];
  } else if (stride == 1) {
    memcpy((double *)to + at, from, count * sizeof(double));
  } else {
    double *values = (double *)to + at;
    for (size_t k = 0; k < count; k++) values[k] = from[k * stride];
  }
}

/* The gains of `steps` steps from `first` on, from f->P on, which is moved. */
FK_STATIC void fk_find_gains(const fk_kalman_engine *engine, const fk_linear *model, fk_kalman *f, size_t first,
                             int steps, fk_gains *gains) {
  const double zeros[FK_KALMAN_LARGEST] = {0.0};
  const size_t n = model->n, m = model->m;
  for (gains->known = 0; gains->known < steps; gains->known++) {
    const size_t t = gains->known, s = first + t;
    f->F = model->F + s * model->F_stride, f->Q = model->Q + s * model->Q_stride;
    f->H = model->H + s * model->H_stride, f->R = model->R + s * model->R_stride;
    engine->predict(f);
    if (!engine->update(f, zeros)) return;
    memcpy(gains->P + t * n * n, f->P, n * n * sizeof(double));
    memcpy(gains->P_prior + t * n * n, f->P_prior, n * n * sizeof(double));
    memcpy(gains->K + t * n * m, f->K, n * m * sizeof(double));
    memcpy(gains->L + t * m * m, f->L, m * m * sizeof(double));
    memcpy(gains->D + t * m, f->D, m * sizeof(double));
    gains->constant[t] = m * FK_LOG_2PI;
    for (size_t i = 0; i < m; i++) gains->constant[t] += log(f->D[i]);
  }
}

FK_INLINE int fk_is_complete(const double *z, size_t count) {
  int missing = 0;
  for (size_t k = 0; k < count; k++) missing |= z[k] != z[k];
  return !missing;
}

/* Take `steps` steps of the series named, at most FK_LANES, with the gains or, if NULL, apart; returns the
 * steps done.  A lane that nobody uses repeats the last one. */
FK_STATIC int fk_many_lanes(const fk_lanes_engine *engine, const fk_many *work, const fk_gains *gains,
                            const size_t *series, int used, size_t first, int steps, const fk_lanes_room *room,
                            double *x, double *P) {
  const size_t n = work->model.n, m = work->model.m, nn = n * n, T = work->n_steps, count = steps;
  const fk_many_output *out = &work->out;
  const int is_single = out->is_single;
  int done = steps;
  for (int lane = 0; lane < FK_LANES; lane++) {
    const size_t s = series[lane < used ? lane : used - 1];
    const double *z = work->z + (s * T + first) * m;
    for (size_t k = 0; k < count * m; k++) room->z[k * FK_LANES + lane] = z[k];
    for (size_t k = 0; k < n; k++) room->x_state[k * FK_LANES + lane] = x[s * n + k];
    if (!gains)
      for (size_t k = 0; k < nn; k++) room->P_state[k * FK_LANES + lane] = P[s * nn + k];
    if (room->u) {
      const double *u = work->u + s * work->u_stride + first * n;
      for (size_t k = 0; k < count * n; k++) room->u[k * FK_LANES + lane] = u[k];
    }
  }
  if (gains) engine->shared(&work->model, gains, first, steps, room);
  else done = engine->apart(&work->model, first, steps, room);
  if (done < steps) return done;
  for (int lane = 0; lane < used; lane++) {
    const size_t s = series[lane], at = s * T + first;
    for (size_t k = 0; k < n; k++) x[s * n + k] = room->x_state[k * FK_LANES + lane];
    if (!gains)
      for (size_t k = 0; k < nn; k++) P[s * nn + k] = room->P_state[k * FK_LANES + lane];
    if (out->x) fk_emit(room->x + lane, FK_LANES, count * n, out->x, at * n, is_single);
    if (out->x_prior) fk_emit(room->x_prior + lane, FK_LANES, count * n, out->x_prior, at * n, is_single);
    if (out->log_likelihood)
      fk_emit(room->log_likelihood + lane, FK_LANES, count, out->log_likelihood, at, is_single);
    if (out->P)
      fk_emit(gains ? gains->P : room->P + lane, gains ? 1 : FK_LANES, count * nn, out->P, at * nn, is_single);
    if (out->P_prior)
      fk_emit(gains ? gains->P_prior : room->P_prior + lane, gains ? 1 : FK_LANES, count * nn, out->P_prior,
              at * nn, is_single);
  }
  return done;
}

/* Filter all series, in room for `fk_many_room` doubles and 2 count indices.  Returns the number of steps
 * done: fewer where S of some series is not positive definite. */
FK_STATIC size_t fk_many_filter(const fk_lanes_engine *engine, const fk_kalman_engine *one, const fk_many *work,
                                double *buffer, size_t *indices) {
  const fk_linear *model = &work->model;
  const size_t n = model->n, m = model->m, nn = n * n, T = fk_many_chunk(model), count = work->count;
  size_t *shared = indices, *apart = indices + count, n_shared = count, n_apart = 0;
  fk_kalman f = {.n = model->n, .m = model->m, .alpha_sq = model->alpha_sq};
  fk_lanes_room room = {0};
  fk_gains gains = {0};
#define FK_TAKE(pointer, size) pointer = buffer, buffer += (size)
  FK_TAKE(room.z, FK_LANES * T * m); /* the lanes first: what they need begins at multiples of 64 bytes */
  FK_TAKE(room.u, FK_LANES * T * n);
  FK_TAKE(room.x, FK_LANES * T * n);
  FK_TAKE(room.x_prior, FK_LANES * T * n);
  FK_TAKE(room.P, FK_LANES * T * nn);
  FK_TAKE(room.P_prior, FK_LANES * T * nn);
  FK_TAKE(room.log_likelihood, FK_LANES * T);
  FK_TAKE(room.x_state, FK_LANES * n);
  FK_TAKE(room.P_state, FK_LANES * nn);
  FK_TAKE(gains.P, T * nn);
  FK_TAKE(gains.P_prior, T * nn);
  FK_TAKE(gains.K, T * n * m);
  FK_TAKE(gains.L, T * m * m);
  FK_TAKE(gains.D, T * m);
  FK_TAKE(gains.constant, T);
  double *x, *P;
  FK_TAKE(x, count * n);
  P = buffer;
#undef FK_TAKE
  room.P_stride = work->out.P ? nn : 0, room.P_prior_stride = work->out.P_prior ? nn : 0;
  if (!work->u) room.u = NULL;
  if (!work->out.x_prior) room.x_prior = NULL;
  if (!work->out.log_likelihood) room.log_likelihood = NULL;
  memcpy(f.P, work->P, nn * sizeof(double));
  for (size_t s = 0; s < count; s++) {
    shared[s] = s;
    memcpy(x + s * n, work->x, n * sizeof(double));
  }
  for (size_t first = 0; first < work->n_steps; first += T) {
    const int steps = work->n_steps - first < T ? (int)(work->n_steps - first) : (int)T;
    if (n_shared) {
      double before[FK_KALMAN_SQUARE];
      size_t kept = 0;
      memcpy(before, f.P, nn * sizeof(double));
      fk_find_gains(one, model, &f, first, steps, &gains);
      for (size_t k = 0; k < n_shared; k++) {
        const size_t s = shared[k];
        if (gains.known == steps && fk_is_complete(work->z + (s * work->n_steps + first) * m, steps * m)) {
          shared[kept++] = s;
        } else {
          apart[n_apart++] = s;
          memcpy(P + s * nn, before, nn * sizeof(double));
        }
      }
      n_shared = kept;
    }
    for (size_t k = 0; k < n_shared; k += FK_LANES)
      fk_many_lanes(engine, work, &gains, shared + k, n_shared - k < FK_LANES ? (int)(n_shared - k) : FK_LANES, first,
                    steps, &room, x, P);
    for (size_t k = 0; k < n_apart; k += FK_LANES) {
      const int used = n_apart - k < FK_LANES ? (int)(n_apart - k) : FK_LANES;
      const int done = fk_many_lanes(engine, work, NULL, apart + k, used, first, steps, &room, x, P);
      if (done < steps) return first + done;
    }
  }
  return work->n_steps;
}

#endif
