/* The fixed point, accelerated (solvers/fixed_point.py) and over-relaxed (network.py). */
#include "kernel.h"

#include <math.h>

/* Solve the (n, n) system s x = b, both overwritten; rows of s are HISTORY apart. */
static void solve_small(double *s, double *b, int n)
{
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) {
            double factor = s[j * HISTORY + i] / s[i * HISTORY + i];
            for (int k = i; k < n; k++)
                s[j * HISTORY + k] -= factor * s[i * HISTORY + k];
            b[j] -= factor * b[i];
        }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            b[i] -= s[i * HISTORY + k] * b[k];
        b[i] /= s[i * HISTORY + i];
    }
}

/* fixed_point.iterate over the n cells `at`: g becomes the last point. Returns the steps taken, -1
 * if the network is singular to rounding. Vectors of n: x, then what is kept of the steps. */
VECTORISED int iterate(int rows, int cols, double *restrict g, const int *restrict at,
                              ptrdiff_t n, const double *restrict measured,
                              const double *restrict low, const double *restrict high,
                              double r_ref, double r_par, double goal, int steps,
                              double *restrict space, Network *restrict network)
{
    double *restrict x = space, *restrict misfit = space + n, *restrict last = space + 2 * n;
    double *restrict d_misfit = space + 3 * n, *restrict d_image = d_misfit + HISTORY * n;
    double rho[CELLS];

    for (ptrdiff_t i = 0; i < n; i++)
        x[i] = log(g[at[i]]);
    for (int step = 0; step < steps; step++) {
        if (network_of(g, rows, cols, network) < 0)
            return -1;
        two_terminal(rows, cols, network, rho);
        double error = 0.0;
        for (ptrdiff_t i = 0; i < n; i++) {
            double off = r_ref / (r_ref + r_par + rho[at[i]]) - r_ref / (r_ref + r_par + measured[i]);
            error += off * off;
        }
        if (error <= goal)
            return step;
        int slot = (step + HISTORY - 1) % HISTORY, used = step < HISTORY ? step : HISTORY;
        for (ptrdiff_t i = 0; i < n; i++) {
            misfit[i] = log(rho[at[i]] / measured[i]);
            /* after d_image stands the last image, which is x + misfit */
            d_misfit[slot * n + i] = misfit[i] - last[i];
            d_image[slot * n + i] = x[i] + misfit[i] - d_image[HISTORY * n + i];
            d_image[HISTORY * n + i] = x[i] + misfit[i];
            last[i] = misfit[i];
        }
        double gram[HISTORY * HISTORY], share[HISTORY], trace = 0.0;
        for (int a = 0; a < used; a++) {
            for (int b = 0; b <= a; b++) {
                double sum = 0.0;
                for (ptrdiff_t i = 0; i < n; i++)
                    sum += d_misfit[a * n + i] * d_misfit[b * n + i];
                gram[a * HISTORY + b] = gram[b * HISTORY + a] = sum;
            }
            trace += gram[a * HISTORY + a];
            share[a] = 0.0;
            for (ptrdiff_t i = 0; i < n; i++)
                share[a] += d_misfit[a * n + i] * misfit[i];
        }
        for (int a = 0; a < used; a++)
            gram[a * HISTORY + a] += 1e-10 * trace + 1e-30;
        solve_small(gram, share, used);
        for (ptrdiff_t i = 0; i < n; i++) {
            double new = x[i] + misfit[i];
            for (int a = 0; a < used; a++)
                new -= share[a] * d_image[a * n + i];
            x[i] = fmin(fmax(new, low[i]), high[i]);
            g[at[i]] = exp(x[i]);
        }
    }
    return steps;
}

/* network.physics_inputs' steps g <- g (rho / measured)^1.5 within [low, high]: changes g, fills rho
 * with that of the g before the last step. -1 if the network is singular to rounding. */
VECTORISED int relax(int rows, int cols, double *restrict g, const double *restrict measured,
                     double low, double high, int steps, double *restrict rho,
                     Network *restrict network)
{
    for (int step = 0; step < steps; step++) {
        if (network_of(g, rows, cols, network) < 0)
            return -1;
        two_terminal(rows, cols, network, rho);
        for (int i = 0; i < rows * cols; i++) {
            double ratio = rho[i] / measured[i];
            g[i] = fmin(fmax(g[i] * ratio * sqrt(ratio), low), high);
        }
    }
    return 0;
}
