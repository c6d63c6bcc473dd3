#include "host/rls.h"

static double rls_update(size_t n, const double *phi, double y, double forgetting, double *theta, double *m)
{
    double mphi[TACT_RLS_MAX];
    double power = forgetting;
    double error = y;
    const double keep = 1.0 / forgetting;
    for (size_t i = 0; i < n; i++) {
        double sum = 0.0;
        for (size_t j = 0; j < n; j++)
            sum += m[i * n + j] * phi[j];
        mphi[i] = sum;
        power += sum * phi[i];
        error -= phi[i] * theta[i];
    }
    const double scale = 1.0 / power;
    for (size_t i = 0; i < n; i++) {
        const double gain = mphi[i] * scale;
        theta[i] += gain * error;
        for (size_t j = 0; j <= i; j++) {
            const double value = (m[i * n + j] - gain * mphi[j]) * keep;
            m[i * n + j] = value;
            m[j * n + i] = value;
        }
    }
    return error;
}

int tact_rls_run(size_t n, size_t count, const double *regressors, const double *output, double forgetting,
                 double *theta, double *m, size_t every, double *theta_history, double *variance_history,
                 double *cost)
{
    if (n == 0 || n > TACT_RLS_MAX || every == 0)
        return -1;
    size_t row = 0;
    size_t left = every;
    double sum = 0.0;
    for (size_t k = 0; k < count; k++) {
        const double error = rls_update(n, regressors + k * n, output[k], forgetting, theta, m);
        sum += error * error;
        if (--left == 0) {
            left = every;
            for (size_t i = 0; i < n; i++) {
                if (theta_history != NULL)
                    theta_history[row * n + i] = theta[i];
                if (variance_history != NULL)
                    variance_history[row * n + i] = m[i * n + i];
            }
            row++;
        }
    }
    if (cost != NULL)
        *cost = sum;
    return 0;
}
