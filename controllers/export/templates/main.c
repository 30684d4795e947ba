/* Plays a recording back through the exported controllers and compares: is this compiler's code the code that was
 * tested? Host only; the controllers themselves need no heap and no files.
 *
 *   pneuid_check servo servo.csv [out.csv]     pneuid_check nmpc nmpc.csv [out.csv]
 *
 * Columns, SI, absolute pressures: t, x, p1, p2, psup, position, velocity, acceleration, jerk, u. The rows beyond the
 * last measurement, whose x is "nan", are the preview. u is what Python commanded at that sample. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "pneuid_nmpc.h"
#include "pneuid_servo.h"

#define TOLERANCE 1e-9 /* V */

typedef struct {
    size_t rows, samples;
    double *t, *u;
    pneuid_measurement *seen;
    pneuid_reference *target;
} recording;

static void *grown(void *block, size_t bytes)
{
    void *found = realloc(block, bytes);
    if (found == NULL) {
        fprintf(stderr, "out of memory\n");
        exit(1);
    }
    return found;
}

/* Read a recording; stops the program when a row cannot be read. */
static recording read_recording(const char *path)
{
    recording run = {0, 0, NULL, NULL, NULL, NULL};
    char line[512];
    size_t room = 0;
    FILE *file = fopen(path, "r");

    if (file == NULL || fgets(line, sizeof line, file) == NULL) {
        fprintf(stderr, "%s: cannot be read\n", path);
        exit(2);
    }
    while (fgets(line, sizeof line, file) != NULL) {
        double value[10];
        char *rest = line;
        int i;
        for (i = 0; i < 10; i++) {
            char *end;
            value[i] = strtod(rest, &end);
            if (end == rest) {
                fprintf(stderr, "%s: row %lu: column %d is not a number\n", path, (unsigned long)run.rows + 2, i + 1);
                exit(2);
            }
            rest = *end == ',' ? end + 1 : end;
        }
        if (run.rows == room) {
            room = room ? 2 * room : 1024;
            run.t = grown(run.t, room * sizeof *run.t);
            run.u = grown(run.u, room * sizeof *run.u);
            run.seen = grown(run.seen, room * sizeof *run.seen);
            run.target = grown(run.target, room * sizeof *run.target);
        }
        run.t[run.rows] = value[0];
        run.seen[run.rows] = (pneuid_measurement){value[1], value[2], value[3], value[4]};
        run.target[run.rows] = (pneuid_reference){value[5], value[6], value[7], value[8]};
        run.u[run.rows] = value[9];
        if (isfinite(value[1])) {
            run.samples = run.rows + 1;
        }
        run.rows++;
    }
    fclose(file);
    return run;
}

/* Play it; writes t and u where a file is given. Returns the largest difference from the recorded command [V]. */
static double play(const recording *run, int predictive, FILE *out)
{
    static pneuid_servo servo;
    static pneuid_nmpc nmpc;
    double largest = 0.0;
    clock_t began;
    size_t k;

    pneuid_servo_init(&servo);
    pneuid_nmpc_init(&nmpc);
    if ((predictive ? pneuid_nmpc_start(&nmpc, run->seen) : pneuid_servo_start(&servo, run->seen)) != 0) {
        fprintf(stderr, "the first row is not finite\n");
        exit(2);
    }
    began = clock();
    for (k = 0; k < run->samples; k++) {
        const double u = predictive ? pneuid_nmpc_step(&nmpc, &run->seen[k], &run->target[k])
                                    : pneuid_servo_step(&servo, &run->seen[k], &run->target[k]);
        const double difference = fabs(u - run->u[k]);
        largest = difference > largest || isnan(difference) ? difference : largest;
        if (out != NULL) {
            fprintf(out, "%.17g,%.17g\n", run->t[k], u);
        }
    }
    printf("%s: %lu samples, largest difference from Python %.2g V, %.1f us per sample\n",
           predictive ? "nmpc" : "servo", (unsigned long)run->samples, largest,
           1e6 * (double)(clock() - began) / CLOCKS_PER_SEC / (double)run->samples);
    return largest;
}

int main(int count, char **words)
{
    const int predictive = count > 1 && strcmp(words[1], "nmpc") == 0;
    const size_t preview = predictive ? PNEUID_NMPC_PREVIEW : 2;
    recording run;
    FILE *out = NULL;
    double largest;

    if (count < 3 || (!predictive && strcmp(words[1], "servo") != 0)) {
        fprintf(stderr, "usage: %s servo|nmpc recording.csv [out.csv]\n", words[0]);
        return 2;
    }
    run = read_recording(words[2]);
    if (run.samples == 0 || run.rows < run.samples + preview - 1) {
        fprintf(stderr, "%s: needs a measurement and %lu rows of preview\n", words[2], (unsigned long)preview - 1);
        return 2;
    }
    if (count > 3) {
        out = fopen(words[3], "w");
        if (out == NULL) {
            fprintf(stderr, "%s: cannot be written\n", words[3]);
            return 2;
        }
        fprintf(out, "t [s],u [V]\n");
    }
    largest = play(&run, predictive, out);
    if (out != NULL) {
        fclose(out);
    }
    free(run.t);
    free(run.u);
    free(run.seen);
    free(run.target);
    return largest <= TOLERANCE ? 0 : 1;
}
