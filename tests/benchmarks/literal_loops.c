/* The fuzzy estimator as its paper prints it: loops over all states and all values of the noise.
 *
 * Layne and Passino, Fuzzy Sets and Systems 122 (2001) 45-72, section 5.1: propagation, update and
 * centre of gravity of a relation on a fixed grid.  The membership of (x, w) and its maximum are
 * taken in one pass, without the array of all (x, w).  Everything that does not depend on w may be
 * moved out of the inner loop by the compiler.  Part of a benchmark, not of the package. */
#include <math.h>

typedef struct {
  int n1, n2, n_noise;
  double low1, step1, low2, step2; /* the grid of the state */
  double low_w, step_w;            /* the values of the noise */
} literal_grid;

/* Propagation: out(x') = max over x, w with x' = f(x, w) of mu(x) mu_w(w), x' on the nearest node. */
#define PROPAGATE(name, F1, F2, ARGUMENT)                                                             \
  void name(const literal_grid *g, const double *mu, const double *mu_w, double *out, ARGUMENT) {     \
    for (long k = 0; k < (long)g->n1 * g->n2; k++) out[k] = 0.0;                                      \
    for (int m = 0; m < g->n1; m++)                                                                   \
      for (int n = 0; n < g->n2; n++)                                                                 \
        for (int o = 0; o < g->n_noise; o++) {                                                        \
          const double x1 = g->low1 + m * g->step1, x2 = g->low2 + n * g->step2;                      \
          const double w = g->low_w + o * g->step_w;                                                  \
          const double y1 = ((F1) - g->low1) / g->step1 + 0.5;                                        \
          const double y2 = ((F2) + w - g->low2) / g->step2 + 0.5;                                    \
          if (y1 >= 0.0 && y1 < g->n1 && y2 >= 0.0 && y2 < g->n2) {                                   \
            const double joint = mu[(long)m * g->n2 + n] * mu_w[o];                                   \
            double *to = out + (long)(int)y1 * g->n2 + (int)y2;                                       \
            if (joint > *to) *to = joint;                                                             \
          }                                                                                           \
        }                                                                                             \
  }

/* A linear model, x' = (x1 + slope x2, x2 + w). */
PROPAGATE(propagate_linear, x1 + slope * x2, x2, double slope)

/* The rocket of section 5.3, with gravity and drag as they should read. */
static double rocket_velocity(double h, double v, double time) {
  const double mass = 20100.0 - 100.0 * time, ratio = 6.37e6 / (6.37e6 + h);
  return v + 2.0 * (4000.0 * 100.0 / mass - 9.8 * ratio * ratio - 0.5 * v * fabs(v) * 0.363 / mass);
}

PROPAGATE(propagate_rocket, x1 + 2.0 * x2, rocket_velocity(x1, x2, time), double time)

/* Update by a measurement of x1: mu(x) max over v with z = x1 + v of mu_v(v), z on the nearest node. */
void update_position(const literal_grid *g, double *mu, const double *mu_v, double z) {
  double best = 0.0;
  for (int m = 0; m < g->n1; m++)
    for (int n = 0; n < g->n2; n++) {
      double likely = 0.0;
      for (int p = 0; p < g->n_noise; p++) {
        const double v = g->low_w + p * g->step_w;
        const double off = z - (g->low1 + m * g->step1) - v;
        if (fabs(off) <= 0.5 * g->step1 && mu_v[p] > likely) likely = mu_v[p];
      }
      const double joint = mu[(long)m * g->n2 + n] *= likely;
      if (joint > best) best = joint;
    }
  if (best > 0.0)
    for (long k = 0; k < (long)g->n1 * g->n2; k++) mu[k] /= best;
}

/* Centre of gravity. */
void center_of_gravity(const literal_grid *g, const double *mu, double *center) {
  double sum = 0.0, first = 0.0, second = 0.0;
  for (int m = 0; m < g->n1; m++)
    for (int n = 0; n < g->n2; n++) {
      const double value = mu[(long)m * g->n2 + n];
      sum += value;
      first += value * (g->low1 + m * g->step1);
      second += value * (g->low2 + n * g->step2);
    }
  center[0] = first / sum;
  center[1] = second / sum;
}
