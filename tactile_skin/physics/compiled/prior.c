/* SPDX-License-Identifier: Apache-2.0 */
/* The prior of `map` (../../solvers/prior.py, which has the same in NumPy). */
#include <math.h>
#include <stdlib.h>

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
double touches(int rows, int cols, const double *x, const double *weight, double spread,
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
