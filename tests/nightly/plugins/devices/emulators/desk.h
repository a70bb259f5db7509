/* State of the emulated devices in a file that the tests map into memory too: faults to inject, commanded forces and
   their times. An environment variable names the file. The tests create it; it outlives the process. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#define ROWS (1 << 17)

struct row { double t_s, force[3], spent_s; int64_t ready, bad, device; };

struct desk {
    double position[3], velocity[3], gripper, transform[16], warmth, most_force, workspace[6];
    double at_s;                /* time of a clock that stands still; 0: the clock of the system */
    int64_t buttons, calibration, style, count, started, disabled, watchdog, status[16];
    int64_t begin_error, end_error, saturated, off, stuck;
    int64_t refuse_code;        /* error code of the function that fails */
    char refuse[32], name[32], second[32]; /* the function that fails; the device names that open */
    char tried[256];            /* requested device names; calls during setup */
    struct row rows[ROWS];
};

static struct desk *desk;

static void attach(void) {
    static char path[4096];
    const char *file_name = getenv("HAPSCENE_EMULATED_DESK");
    if (file_name == NULL || (desk != NULL && strcmp(path, file_name) == 0)) return;
    int file = open(file_name, O_RDWR);
    desk = mmap(NULL, sizeof *desk, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, file, 0);
    close(file);
    strncpy(path, file_name, sizeof path - 1);
}

static double now(void) {
    struct timespec t;
    if (desk != NULL && desk->at_s != 0.0) return desk->at_s;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

static void note(double x, double y, double z, int ready, int bad) {
    struct row *row = &desk->rows[desk->count % ROWS];
    row->t_s = now(), row->force[0] = x, row->force[1] = y, row->force[2] = z, row->ready = ready, row->bad = bad;
    row->spent_s = 0;
    desk->count++;
}

static void log_call(const char *word) {
    size_t room = sizeof desk->tried - strlen(desk->tried) - 2;
    strncat(desk->tried, word, room);
    strcat(desk->tried, ";");
}

/* xorshift generator of 64 random bits; seed 0 disables the mutation of values */
static uint64_t seed;

static uint64_t draw(void) {
    seed ^= seed << 13, seed ^= seed >> 7, seed ^= seed << 17;
    return seed;
}

static double mutant(double good, int *bad) {
    static const double strange[] = {NAN, INFINITY, -INFINITY, 1e300, -1e18, 1e5, 5e-324};
    if (seed == 0 || draw() % 15) return good;
    int which = draw() % 7;
    if (which < 6) *bad = 1;
    return strange[which];
}
