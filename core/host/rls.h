/* Recursive least squares with exponential forgetting.
 *
 *   e = y - phi' theta          k = M phi / (lambda + phi' M phi)
 *   theta += k e                M = (M - k phi' M) / lambda
 *
 * M (the inverse of the information, called covariance here: times the residual's variance it is one) is kept
 * symmetric. Memory belongs to the caller; nothing is allocated. At most TACT_RLS_MAX parameters.
 * Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems, chapter 12.
 *
 * Example use:
 *   double theta[3] = {0}, m[9] = {1e6,0,0, 0,1e6,0, 0,0,1e6};
 *   tact_rls_run(3, count, regressors, output, 1.0, theta, m, 100, theta_history, variance_history, &cost);
 */
#ifndef TACT_RLS_H
#define TACT_RLS_H

#include <stddef.h>

enum { TACT_RLS_MAX = 16 };

/* regressors: count rows of n; output: count. After every `every`-th sample theta goes to theta_history (rows of n) and
 * the diagonal of M to variance_history; both hold count / every rows, or are NULL. cost gathers the squared errors
 * before the update. Returns 0, or -1 when n or every is out of range. */
int tact_rls_run(size_t n, size_t count, const double *regressors, const double *output, double forgetting,
                 double *theta, double *m, size_t every, double *theta_history, double *variance_history,
                 double *cost);

#endif
