/* The cost of what differs between cells: numpy_kernel.py holds the same in NumPy. */
#include "kernel.h"

#include <math.h>

#define FAR 1e100 /* from here on a product of squares is not multiplied by another */

/* sum of w log(s) / 2, with one logarithm for many s of one w */
typedef struct {
    double sum, weight, product;
} Logs;

static void add(Logs *logs, double weight, double square)
{
    if (weight != logs->weight || !(logs->product < FAR && logs->product > 1.0 / FAR)) {
        logs->sum += 0.5 * logs->weight * log(logs->product);
        logs->weight = weight;
        logs->product = 1.0;
    }
    logs->product *= square;
}

double roughness(int rows, int cols, const double *restrict x, const double *restrict weight,
             double square, double *restrict gradient, double *restrict diagonal,
             double *restrict entries)
{
    int across = cols - 1;
    ptrdiff_t n_right = (ptrdiff_t)rows * across, n_down = (ptrdiff_t)(rows - 1) * cols;
    Logs logs = {0.0, 0.0, 1.0};

    for (int a = 0; a < rows * cols; a++)
        gradient[a] = diagonal[a] = 0.0;
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < across; j++) {
            ptrdiff_t d = (ptrdiff_t)i * across + j, a = (ptrdiff_t)i * cols + j;
            double apart = x[a + 1] - x[a], s = square + apart * apart;
            double w = weight[d] / s, pull = w * apart;
            add(&logs, weight[d], s);
            entries[d] = -w;
            gradient[a + 1] += pull;
            gradient[a] -= pull;
            diagonal[a + 1] += w;
            diagonal[a] += w;
        }
    for (ptrdiff_t d = 0; d < n_down; d++) {
        double apart = x[d + cols] - x[d], s = square + apart * apart;
        double w = weight[n_right + d] / s, pull = w * apart;
        add(&logs, weight[n_right + d], s);
        entries[n_right + d] = -w;
        gradient[d + cols] += pull;
        gradient[d] -= pull;
        diagonal[d + cols] += w;
        diagonal[d] += w;
    }
    return logs.sum + 0.5 * logs.weight * log(logs.product);
}
