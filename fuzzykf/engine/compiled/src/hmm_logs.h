/* Forward and backward pass in logarithms: slow, whatever the densities. */
#ifndef FUZZYKF_HMM_LOGS_H
#define FUZZYKF_HMM_LOGS_H

#include "lanes.h"

/* Pairs of states of positive probability, row by row; `from` is NULL for all M M of them. */
typedef struct {
  size_t n;
  const int *from, *to;
} fk_arrows;

/* log of the sum of n exponentials; minus infinity stands for zero */
FK_STATIC double fk_log_sum(const double *a, int n) {
  double top = -INFINITY, sum = 0.0;
  for (int k = 0; k < n; k++) top = a[k] > top ? a[k] : top;
  if (!(top > -INFINITY)) return top;
  for (int k = 0; k < n; k++) sum += exp(a[k] - top);
  return log(sum) + top;
}

/* log e_ij + log P_ij; minus infinity where P_ij is zero, whatever e is. */
FK_INLINE double fk_log_move(double transition, double log_e) {
  return transition == 0.0 ? -INFINITY : log_e + log(transition);
}

/* As fk_forward_backward; `log_likelihood` holds the totals, gamma the forward messages on the
 * way.  scratch: 3 M. */
FK_STATIC void fk_forward_backward_logs(int T, int M, const double *first, const double *transition,
                                     const double *log_emission, double *gamma, double *xi,
                                     double *log_likelihood, double *scratch) {
  const size_t pairs = (size_t)M * M;
  double *terms = scratch, *beta = scratch + M, *now = scratch + 2 * M;
  for (int i = 0; i < M; i++) gamma[i] = log(first[i]), beta[i] = 0.0;
  for (int n = 0; n < T; n++) {
    const double *log_e = log_emission + n * pairs, *alpha = gamma + (size_t)n * M;
    double *next = gamma + (size_t)(n + 1) * M;
    for (int j = 0; j < M; j++) {
      for (int i = 0; i < M; i++) terms[i] = alpha[i] + fk_log_move(transition[i * M + j], log_e[i * M + j]);
      next[j] = fk_log_sum(terms, M);
    }
    const double total = fk_log_sum(next, M);
    for (int j = 0; j < M; j++) next[j] -= total;
    log_likelihood[n] = total;
  }
  for (int n = T - 1; n >= 0; n--) {
    const double *log_e = log_emission + n * pairs, *alpha = gamma + (size_t)n * M;
    double *after = gamma + (size_t)(n + 1) * M;
    for (int i = 0; i < M; i++) {
      for (int j = 0; j < M; j++) {
        const double move = fk_log_move(transition[i * M + j], log_e[i * M + j]);
        terms[j] = move + beta[j];
        xi[n * pairs + i * M + j] = exp(alpha[i] + move + (beta[j] - log_likelihood[n]));
      }
      now[i] = fk_log_sum(terms, M) - log_likelihood[n];
    }
    for (int j = 0; j < M; j++) after[j] = exp(after[j] + beta[j]), beta[j] = now[j];
  }
  for (int i = 0; i < M; i++) gamma[i] = exp(gamma[i] + beta[i]);
}

#endif
