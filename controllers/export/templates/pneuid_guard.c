#include "pneuid_guard.h"

#include "pneuid_math.h"
#include "pneuid_model.h"

int pneuid_all_finite(const pneuid_measurement *seen)
{
    return isfinite(seen->x) && isfinite(seen->p1) && isfinite(seen->p2) && isfinite(seen->psup);
}

pneuid_measurement pneuid_trusted(const pneuid_measurement *seen, const pneuid_measurement *before)
{
    pneuid_measurement found;
    found.x = isfinite(seen->x) ? seen->x : before->x;
    found.p1 = isfinite(seen->p1) ? seen->p1 : before->p1;
    found.p2 = isfinite(seen->p2) ? seen->p2 : before->p2;
    found.psup = isfinite(seen->psup) ? seen->psup : before->psup;
    return found;
}

double pneuid_limited(double u)
{
    return smaller(larger(u, pneuid_lowest), pneuid_highest);
}
