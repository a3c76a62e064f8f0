/* Random numbers. Every device draws from a stream of its own, so that adding one device leaves the
 * draws of the others as they were. */
#ifndef EMULATOR_CHANCE_H
#define EMULATOR_CHANCE_H

#include <stdbool.h>
#include <stdint.h>

/* xoshiro256** 1.0 (Blackman and Vigna, ACM TOMS 47:36, 2021). */
typedef struct chance {
    uint64_t state[4];
} chance;

/* A stream that depends on the seed and on a name, such as "air" or "slave_1.adc". */
chance chance_stream(uint64_t seed, const char *name);

double chance_uniform(chance *c);              /* in [0, 1) */
double chance_normal(chance *c);               /* mean 0, deviation 1 */
bool chance_happens(chance *c, double probability);
uint64_t chance_bits(chance *c);

#endif
