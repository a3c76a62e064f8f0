#include "chance.h"

#include <math.h>

static uint64_t rotate(uint64_t x, int by)
{
    return x << by | x >> (64 - by);
}

/* splitmix64, by which xoshiro's authors seed it. */
static uint64_t spread(uint64_t *x)
{
    uint64_t z = *x += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

chance chance_stream(uint64_t seed, const char *name)
{
    uint64_t mixed = 0xcbf29ce484222325u; /* FNV-1a of the name */
    for (; *name; name++)
        mixed = (mixed ^ (unsigned char)*name) * 0x100000001b3u;
    mixed ^= spread(&seed);
    chance c;
    for (int i = 0; i < 4; i++)
        c.state[i] = spread(&mixed);
    return c;
}

uint64_t chance_bits(chance *c)
{
    uint64_t *s = c->state;
    uint64_t result = rotate(s[1] * 5, 7) * 9;
    uint64_t t = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = rotate(s[3], 45);
    return result;
}

double chance_uniform(chance *c)
{
    return (double)(chance_bits(c) >> 11) * 0x1p-53;
}

double chance_normal(chance *c)
{
    /* Box and Muller; the second of each pair is not kept, so that a draw has no memory. */
    double radius = sqrt(-2.0 * log(1.0 - chance_uniform(c)));
    return radius * cos(6.283185307179586 * chance_uniform(c));
}

bool chance_happens(chance *c, double probability)
{
    return probability > 0.0 && chance_uniform(c) < probability;
}
