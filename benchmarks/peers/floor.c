/* The likelihood of the half car in plain C: the same recursion, one car at a time (LANES = 1) or
   LANES cars side by side in vectors.  Arrays end in the lanes; the state is x (4), noise of the
   inputs (2), biases (2) and noise (2) of the outputs; of P the lower triangle is used. */
#include <math.h>
#include <string.h>

#if LANES > 1
typedef double T __attribute__((vector_size(8 * LANES)));
#define LANE(x, q) ((x)[q])
#else
typedef double T;
#define LANE(x, q) (x)
#endif
#define N 10
#define LOW(a, b) ((a) > (b) ? P[a][b] : P[b][a])
#define EACH(i, n) _Pragma("GCC unroll 16") for (int i = 0; i < (n); i++)

void run(int steps, const double *step, const double *moments, const double *spread,
         const double *reading, const T carry[4][6], const T Q[2][4][4], const T drive[2][8][4],
         const T C[2][4], const T *white, const T *filtered, const T *keep, const double *start,
         double *total) {
    T P[N][N], x[N], decay[N], gained[4], left = {0}, product = {0};
    memset(P, 0, sizeof P);
    memset(x, 0, sizeof x);
    double logs[LANES] = {0};
    EACH(a, 4) EACH(b, 4) P[a][b] += start[6 * a + b];
    EACH(a, 2) EACH(b, 2) P[6 + a][6 + b] += start[6 * (4 + a) + 4 + b];
    EACH(u, 2) { P[4 + u][4 + u] = filtered[u]; P[8 + u][8 + u] = filtered[2 + u]; }
    EACH(u, 2) { decay[4 + u] = keep[u]; decay[8 + u] = keep[2 + u]; decay[6 + u] = keep[u] * 0 + 1; }
    EACH(s, 4) gained[s] = filtered[s] * (1 - keep[s] * keep[s]);
    product = product + 1;
    for (int k = 0; k < steps; k++) {
        if (step[k] > 0) {
            T half[4][N], ahead[4], intensity[2];
            const double *m = moments + 16 * k, *s = spread + 4 * k;
            EACH(u, 2) intensity[u] = white[u] * s[u] + s[2 + u];
            EACH(a, 4) {
                T sum = carry[a][0] * x[0];
                EACH(c, 5) sum += carry[a][c + 1] * x[c + 1];
                EACH(u, 2) EACH(j, 8) sum += drive[u][j][a] * m[8 * u + j];
                ahead[a] = sum;
            }
            EACH(a, 4) x[a] = ahead[a];
            EACH(u, 2) { x[4 + u] *= keep[u]; x[8 + u] *= keep[2 + u]; }
            EACH(a, 4) EACH(b, N) {
                T sum = carry[a][0] * LOW(0, b);
                EACH(c, 5) sum += carry[a][c + 1] * LOW(c + 1, b);
                half[a][b] = sum;
            }
            EACH(a, 4) for (int b = 0; b <= a; b++) {
                T sum = intensity[0] * Q[0][a][b] + intensity[1] * Q[1][a][b];
                EACH(c, 6) sum += half[a][c] * carry[b][c];
                P[a][b] = sum;
            }
            EACH(a, 4) EACH(b, 6) P[4 + b][a] = half[a][4 + b] * decay[4 + b];
            EACH(a, 6) for (int b = 0; b <= a; b++) P[4 + a][4 + b] *= decay[4 + a] * decay[4 + b];
            EACH(u, 2) { P[4 + u][4 + u] += gained[u]; P[8 + u][8 + u] += gained[2 + u]; }
        }
        EACH(y, 2) {
            T PC[N], S = white[2 + y], mean = x[6 + y] + x[8 + y];
            EACH(b, N) {
                T sum = LOW(6 + y, b) + LOW(8 + y, b);
                EACH(a, 4) sum += C[y][a] * LOW(a, b);
                PC[b] = sum;
            }
            EACH(a, 4) { S += C[y][a] * PC[a]; mean += C[y][a] * x[a]; }
            S += PC[6 + y] + PC[8 + y];
            T inverse = 1 / S, nu = reading[2 * k + y] - mean;
            product *= S;
            left += nu * nu * inverse;
            EACH(a, N) {
                T gain = PC[a] * inverse;
                x[a] += gain * nu;
                for (int b = 0; b <= a; b++) P[a][b] -= gain * PC[b];
            }
        }
        if (k % 16 == 15) for (int q = 0; q < LANES; q++) {  /* one logarithm for 32 readings */
            logs[q] += log(LANE(product, q));
            LANE(product, q) = 1;
        }
    }
    for (int q = 0; q < LANES; q++)
        total[q] = -0.5 * (logs[q] + log(LANE(product, q)) + LANE(left, q)
                           + 2 * steps * log(2 * M_PI));
}
