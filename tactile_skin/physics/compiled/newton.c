/* SPDX-License-Identifier: Apache-2.0 */
/* A step of the exact inverse (../../solvers/newton.py, which has the same in NumPy). */
#include <math.h>
#include <stdlib.h>

int solve(int rows, int cols, const double *g, double *log_det, double *k, double *rho);
int solve_in_box(int n, const float *precision, const double *b, const double *low,
                 const double *high, double *dx, int *inside);

/* newton._next of a floating matrix. `given`: pictures of the measured rho, of both bounds and of what
 * noise may lift. moved: of the last step, then of this one; there: g and rho after it. k_there
 * comes as zeros. Returns the number of unknowns; -1: NumPy has to climb. */
int newton_step(int rows, int cols, const double *given, const double *numbers, const double *g,
                const double *rho, const double *k, double *moved, double *log_det, double *there,
                double *k_there)
{
    enum { BOUND, DONE, CURVED, JOIN_SHARE, PAST, MOST, ROUNDS };
    int cells = rows * cols, lines = rows + cols, n = 0, met = 1;
    const double *measured = given, *low = given + cells, *high = low + cells, *chance = high + cells;
    double *room = calloc(6 * cells + 1, sizeof *room), *gradient = room, *root = room + cells;
    double *b = root + cells, *x = b + cells, *from = x + cells, *to = from + cells;
    double *new_rho = there + cells, most = 0.0, large = 0.0, climbs = 0.0, past = 0.0;
    int *held = calloc(3 * cells + 1, sizeof *held), *at = held + cells, *inside = at + cells;
    float *matrix = NULL;

    for (int a = 0; a < cells && room && held; a++) {
        int at_rest = g[a] <= low[a] * numbers[BOUND], at_top = g[a] >= high[a] / numbers[BOUND];
        gradient[a] = rho[a] - measured[a];
        held[a] = g[a] == 0.0 || (at_rest ? gradient[a] <= chance[a] : at_top && gradient[a] >= 0.0);
        gradient[a] *= !held[a];
        met &= !at_rest || fabs(gradient[a]) <= numbers[DONE] * g[a] * rho[a] * rho[a];
        most = fmax(most, fabs(gradient[a]) / rho[a]);
    }
    met &= numbers[CURVED] * *moved * *moved < numbers[DONE];
    for (int a = 0; a < cells && room && held && !met; a++) {
        held[a] |= g[a] <= low[a] * numbers[BOUND]
                   && fabs(gradient[a]) / rho[a] <= numbers[JOIN_SHARE] * most;
        gradient[a] *= !held[a];
        there[a] = g[a];
        if (held[a])
            continue;
        root[n] = sqrt(g[a]);
        b[n] = root[n] * rho[a] * log(rho[a] / measured[a]);
        from[n] = (low[a] - g[a]) / root[n];
        to[n] = (high[a] - g[a]) / root[n];
        inside[n] = 1;
        at[n++] = a;
    }
    int failed = !room || !held || n > numbers[MOST];
    if (!failed && n && (matrix = malloc((size_t)n * n * sizeof *matrix)))
        for (int i = 0; i < n; i++) {
            const double *row = k + at[i] / cols * lines, *col = k + (rows + at[i] % cols) * lines;
            for (int j = i; j < n; j++) {
                int one = at[j] / cols, other = rows + at[j] % cols;
                float t = (float)(row[one] - row[other] - col[one] + col[other]);
                matrix[i * n + j] = (float)(root[i] * root[j]) * (t * t);
            }
        }
    failed |= n && (!matrix || solve_in_box(n, matrix, b, from, to, x, inside) < 0);
    for (int i = 0; i < n && !failed; i++) {
        double here = g[at[i]], least = fmax(low[at[i]], 0.05 * here);
        there[at[i]] = fmin(fmax(here + root[i] * x[i], least), high[at[i]]);
    }
    failed = failed || (n && solve(rows, cols, there, log_det, k_there, new_rho) < 0);
    for (int a = 0; a < cells && n && !failed; a++) {
        double by = there[a] - g[a];
        *moved = fmax(a ? *moved : 0.0, fabs(by / g[a]));
        large = fmax(large, fabs(by) / numbers[ROUNDS]);
        climbs += gradient[a] * by;
        past += (new_rho[a] - measured[a]) * by;
    }
    free(room);
    free(held);
    free(matrix);
    return failed || (large >= 1.0 && past < -numbers[PAST] * climbs) ? -1 : n;
}
