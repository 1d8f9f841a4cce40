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
             const double *restrict square, double *restrict gradient, double *restrict diagonal,
             double *restrict entries)
{
    int across = cols - 1;
    ptrdiff_t n_right = (ptrdiff_t)rows * across, n_down = (ptrdiff_t)(rows - 1) * cols;
    ptrdiff_t n_twist = (ptrdiff_t)(rows - 1) * across;
    double step[CELLS]; /* to the right */
    double *restrict right = entries, *restrict down = right + n_right;
    double *restrict twist = down + n_down, *restrict turned = twist + n_twist;
    Logs logs = {0.0, 0.0, 1.0};

    for (int a = 0; a < rows * cols; a++)
        gradient[a] = diagonal[a] = 0.0;
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < across; j++) {
            ptrdiff_t d = (ptrdiff_t)i * across + j, a = (ptrdiff_t)i * cols + j;
            double apart = step[d] = x[a + 1] - x[a], s = square[d] + apart * apart;
            double w = weight[d] / s, pull = w * apart;
            add(&logs, weight[d], s);
            right[d] = -w;
            gradient[a + 1] += pull;
            gradient[a] -= pull;
            diagonal[a + 1] += w;
            diagonal[a] += w;
        }
    for (ptrdiff_t d = 0; d < n_down; d++) {
        double apart = x[d + cols] - x[d], s = square[n_right + d] + apart * apart;
        double w = weight[n_right + d] / s, pull = w * apart;
        add(&logs, weight[n_right + d], s);
        down[d] = -w;
        gradient[d + cols] += pull;
        gradient[d] -= pull;
        diagonal[d + cols] += w;
        diagonal[d] += w;
    }
    weight += n_right + n_down;
    square += n_right + n_down;
    for (int i = 0; i + 1 < rows; i++)
        for (int j = 0; j < across; j++) {
            ptrdiff_t d = (ptrdiff_t)i * across + j, a = (ptrdiff_t)i * cols + j, b = a + cols;
            double apart = step[d + across] - step[d], s = square[d] + apart * apart;
            double w = weight[d] / s, pull = w * apart;
            add(&logs, weight[d], s);
            twist[d] = turned[d] = w;
            right[d] -= w;
            right[d + across] -= w;
            down[a] -= w;
            down[a + 1] -= w;
            gradient[b + 1] += pull;
            gradient[b] -= pull;
            gradient[a + 1] -= pull;
            gradient[a] += pull;
            diagonal[a] += w;
            diagonal[a + 1] += w;
            diagonal[b] += w;
            diagonal[b + 1] += w;
        }
    return logs.sum + 0.5 * logs.weight * log(logs.product);
}
