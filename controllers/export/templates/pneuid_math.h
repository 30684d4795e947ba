/* What the code uses beside <math.h>. fmin and fmax are library calls on most targets; a comparison is an instruction. */
#ifndef PNEUID_MATH_H
#define PNEUID_MATH_H

#include <math.h>

static inline double smaller(double a, double b)
{
    return a < b ? a : b;
}

static inline double larger(double a, double b)
{
    return a > b ? a : b;
}

static inline double sign(double a)
{
    return (double)((a > 0.0) - (a < 0.0));
}

#endif
