/* SPDX-License-Identifier: Apache-2.0 */
/* The prior of `map` (../../solvers/prior.py, which has the same in NumPy). */
#include <math.h>
#include <stdlib.h>

int solve(int rows, int cols, const double *g, double *log_det, double *k, double *rho);
int hessian_product(int rows, int cols, const double *k, const double *p, double *out);

#define FAR 1e100 /* beyond it a product of squares is not multiplied by another */

/* A sum of w log(s) / 2, with one logarithm for many s of one w. */
typedef struct {
    double sum, weight, product;
} Logs;

static inline void add(Logs *logs, double weight, double square)
{
    if (weight != logs->weight || !(logs->product < FAR && logs->product > 1.0 / FAR)) {
        logs->sum += 0.5 * logs->weight * log(logs->product);
        logs->weight = weight;
        logs->product = 1.0;
    }
    logs->product *= square;
}

/* prior.touches; gradient and diagonal come as zeros. Returns the cost. */
static double touches(int rows, int cols, const double *x, const double *weight, double spread,
                      double *gradient, double *diagonal, double *entries)
{
    Logs logs = {0.0, 0.0, 1.0};

    for (int down = 0, d = 0; down < 2; down++)
        for (int i = 0; i < rows - down; i++)
            for (int j = 0; j < cols - !down; j++, d++) {
                int a = i * cols + j, b = down ? a + cols : a + 1;
                double apart = x[b] - x[a], s = spread * spread + apart * apart;
                double w = weight[d] / s, pull = w * apart;
                add(&logs, weight[d], s);
                entries[d] = -w;
                gradient[b] += pull;
                gradient[a] -= pull;
                diagonal[b] += w;
                diagonal[a] += w;
            }
    for (int a = 0; a < rows * cols; a++) {
        add(&logs, 2.0, 1.0 + x[a] / spread);
        gradient[a] += 1.0 / (x[a] + spread);
    }
    return logs.sum + 0.5 * logs.weight * log(logs.product);
}

/* What prior.Point is of a floating readout. `reading`: pictures of the ADC ratio, of which readings
 * are known, which are capped, and of the cells' offset. sums: log_det, the prior's value, the cost.
 * k and pictures come as zeros. */
int point(int rows, int cols, const double *g, const double *reading, const double *numbers,
          const double *weights, double spread, double *sums, double *k, double *pictures,
          double *entries)
{
    enum { R_REF, IN_SERIES, FULL_SCALE, THRESHOLD, NOISE, STD, REST };
    int cells = rows * cols;
    const double *known = reading + cells, *capped = known + cells, *offset = capped + cells;
    double *rho = pictures, *misfit = rho + cells, *weight = misfit + cells, *gx = weight + cells;
    double *x = gx + cells, *gradient = x + cells, *diagonal = gradient + cells;
    double *own = diagonal + cells, *pull = own + cells, *slope = pull + cells, *alone = slope + cells;

    if (solve(rows, cols, g, sums, k, rho) < 0)
        return -1;
    for (int a = 0; a < cells; a++) {
        double adc = numbers[R_REF] / (numbers[IN_SERIES] + rho[a]), falls = adc * adc / numbers[R_REF];
        double over = (numbers[THRESHOLD] - adc) * numbers[FULL_SCALE] - numbers[NOISE];
        misfit[a] = known[a] * (reading[a] - adc) * numbers[FULL_SCALE] + capped[a] * fmin(over, 0.0);
        misfit[a] /= numbers[STD];
        weight[a] = known[a] || misfit[a] != 0.0 ? numbers[FULL_SCALE] / numbers[STD] : 0.0;
        gx[a] = g[a] - offset[a];
        x[a] = g[a] != 0.0 ? log(gx[a] * numbers[REST]) : 0.0;
        own[a] = rho[a] * rho[a] * falls * weight[a] * gx[a];
        pull[a] = weight[a] * misfit[a] * falls;
        sums[2] += 0.5 * misfit[a] * misfit[a];
    }
    sums[1] = touches(rows, cols, x, weights, spread, gradient, diagonal, entries);
    sums[2] += sums[1];
    if (hessian_product(rows, cols, k, pull, pull) < 0)
        return -1;
    for (int a = 0; a < cells; a++) {
        pull[a] *= gx[a];
        slope[a] = pull[a] - gradient[a];
        if (g[a] != 0.0)
            alone[a] = slope[a] * fabs(slope[a]) / (own[a] * own[a] + diagonal[a] + 1e-9);
    }
    return 0;
}

/* The prior's part of prior.precision: adds it to the upper triangle of total, (n, n), over the
 * `free` cells, rising. entries: NULL, or of the differences. -1: there are no such cells. */
int add_terms(int rows, int cols, int n, const int *at, const double *diagonal,
              const double *entries, float *total)
{
    int cells = rows * cols, failed = 0, *place = calloc(cells + 1, sizeof *place);

    for (int k = 0; k < n; k++)
        failed |= at[k] < 0 || at[k] >= cells || (k && at[k] <= at[k - 1]);
    if (!place || failed) {
        free(place);
        return -1;
    }
    for (int k = 0; k < n; k++) {
        total[k * n + k] += (float)diagonal[at[k]];
        place[at[k]] = k + 1;
    }
    for (int down = 0, d = 0; entries && down < 2; down++)
        for (int i = 0; i < rows - down; i++)
            for (int j = 0; j < cols - !down; j++, d++) {
                int a = i * cols + j, b = down ? a + cols : a + 1;
                if (place[a] && place[b])
                    total[(place[a] - 1) * n + place[b] - 1] += (float)entries[d];
            }
    free(place);
    return 0;
}
