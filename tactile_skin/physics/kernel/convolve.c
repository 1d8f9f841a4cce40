/* A convolution of the small networks: numpy_kernel.py holds the same in NumPy. */
#include "kernel.h"

#include <string.h>

/* Sums that are built at once: of THREE outputs at two vectors of cells of a row. They are variables
 * of their own, since compilers keep no array in registers. */
enum { LANES = 8, WIDE = 2 * LANES, THREE = 3, TAPS = 3 };
typedef float Lanes __attribute__((vector_size(LANES * sizeof(float)), aligned(sizeof(float))));

/* Floats from a row to the next of a picture that is padded with zeros. */
static ptrdiff_t padded_line(int cols, int dilation)
{
    return (cols + WIDE - 1) / WIDE * WIDE + 2 * dilation;
}

ptrdiff_t convolve_space(int channels, int rows, int cols, int dilation)
{
    return channels * (rows + 2 * dilation) * padded_line(cols, dilation);
}

/* kernel.convolve; `space` holds convolve_space zeros. */
VECTORISED void convolve(int channels, int rows, int cols, int n_out, int dilation,
                         const float *restrict picture, const float *restrict layer,
                         float *restrict out, float *restrict space)
{
    ptrdiff_t line = padded_line(cols, dilation), plane = (rows + 2 * dilation) * line;
    ptrdiff_t bias = TAPS * TAPS * channels, width = bias + 1;

    for (int c = 0; c < channels; c++)
        for (int i = 0; i < rows; i++)
            memcpy(space + c * plane + (i + dilation) * line + dilation,
                   picture + ((ptrdiff_t)c * rows + i) * cols, cols * sizeof *picture);
    for (int first = 0; first < n_out; first += THREE) {
        int n = n_out - first < THREE ? n_out - first : THREE;
        const float *a = layer + first * width; /* where there are fewer, the last one again */
        const float *b = n > 1 ? a + width : a, *c = n > 2 ? b + width : b;
        for (int i = 0; i < rows; i++)
            for (int j = 0; j < cols; j += WIDE) {
                Lanes zero = {0.0f};
                Lanes a0 = zero + a[bias], b0 = zero + b[bias], c0 = zero + c[bias];
                Lanes a1 = a0, b1 = b0, c1 = c0;
                const float *corner = space + i * line + j;
                for (int k = 0; k < bias; corner += plane)
                    for (int y = 0; y < TAPS; y++)
                        for (int x = 0; x < TAPS; x++, k++) {
                            const Lanes *from = (const Lanes *)(corner + dilation * (y * line + x));
                            a0 += a[k] * from[0];
                            a1 += a[k] * from[1];
                            b0 += b[k] * from[0];
                            b1 += b[k] * from[1];
                            c0 += c[k] * from[0];
                            c1 += c[k] * from[1];
                        }
                Lanes sums[THREE][2] = {{a0, a1}, {b0, b1}, {c0, c1}};
                for (int o = 0; o < n; o++)
                    memcpy(out + ((ptrdiff_t)(first + o) * rows + i) * cols + j, sums[o],
                           (cols - j < WIDE ? cols - j : WIDE) * sizeof *out);
            }
    }
}
