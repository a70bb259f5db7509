/* Emulates the functions of HDAPI that the driver uses: scheduler thread, frames, error stack, calibration. */
#include "desk.h"

#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <sys/file.h>

typedef unsigned int (*callback)(void *);
typedef struct { unsigned int code; int internal; unsigned int device; } error_info;
struct task { callback call; void *data; unsigned long handle; int once, over; };

static unsigned int errors[64];
static int error_count, in_frame[2], bad_frame, enabled[2], running, held[2], now_at; /* of two devices: 5 and 6 */
static double force[2][3], period_s = 1e-3;
static struct task tasks[8];
static unsigned long handles;
static pthread_t thread;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t over = PTHREAD_COND_INITIALIZER;

static void push(unsigned int code) { if (error_count < 64) errors[error_count++] = code; }

static int refused(const char *function) {
    if (strcmp(desk->refuse, function)) return 0;
    push(desk->refuse_code);
    return 1;
}

error_info hdGetError(void) {
    error_info info = {error_count ? errors[--error_count] : 0, -7, 3};
    if (seed && draw() % 97 == 0) info.code = draw() % 3 ? 0x200 + draw() % 5 : draw() | 1;
    if (seed && info.code) bad_frame = 1;
    return info;
}

unsigned int hdInitDevice(const char *name) {
    attach();
    log_call(name ? name : "NULL");
    int at = desk->second[0] && !strcmp(desk->second, name ? name : "NULL");
    if (refused("hdInitDevice") || (!at && strcmp(desk->name, name ? name : "NULL"))) { push(0x302); return 0xFFFFFFFF; }
    if (running) return push(0x102), 0xFFFFFFFF;
    desk->stuck = 0; /* of the process before */
    char path[4096];
    snprintf(path, sizeof path, "%s%s", getenv("HAPSCENE_EMULATED_DESK"), at ? ".second" : "");
    held[at] = open(path, O_RDWR | O_CREAT, 0600);
    if (flock(held[at], LOCK_EX | LOCK_NB)) return close(held[at]), push(0x301), 0xFFFFFFFF; /* the dead hold nothing */
    desk->started = 1, enabled[at] = 0, in_frame[at] = 0, now_at = at;
    return 5 + at;
}

void hdDisableDevice(unsigned int device) {
    if (running) push(0x102);
    close(held[device - 5]);
    desk->started = 0, desk->disabled++;
}

void hdMakeCurrentDevice(unsigned int device) { if (device != 5 && device != 6) push(0x104); else now_at = device - 5; }

void hdBeginFrame(unsigned int device) {
    if (desk->begin_error) push(desk->begin_error);
    if (in_frame[now_at] || device != 5 + now_at) push(0x400);
    in_frame[now_at] = 1, force[now_at][0] = force[now_at][1] = force[now_at][2] = NAN;
}

void hdEndFrame(unsigned int device) {
    if (!in_frame[now_at]) push(0x401);
    in_frame[now_at] = 0;
    double *f = force[now_at];
    desk->rows[desk->count % ROWS].device = now_at; /* before the row counts */
    note(f[0], f[1], f[2], desk->calibration == 0x5000 && enabled[now_at], bad_frame || desk->begin_error != 0);
    bad_frame = 0;
    if (desk->end_error) push(desk->end_error);
}

void hdEnable(unsigned int what) {
    if (refused("hdEnable")) return;
    log_call(what == 0x4000 ? "force" : what == 0x4001 ? "clamp" : "?");
    if (what == 0x4000) enabled[now_at] = 1;
}

unsigned char hdIsEnabled(unsigned int what) { return what == 0x4000 && enabled[now_at] && !desk->off; }

void hdGetIntegerv(unsigned int what, int *to) {
    if (refused("hdGetIntegerv")) return;
    if (what == 0x2555) *to = desk->style;
    else if (what != 0x2000) push(0x100);
    else if (!in_frame[now_at]) push(0x402);
    else *to = seed && draw() % 20 == 0 ? (int)draw() : desk->buttons;
}

void hdGetDoublev(unsigned int what, double *to) {
    int i, unused;
    if (what >= 0x2000 && what < 0x2500 && !in_frame[now_at]) push(0x402);
    else if (what == 0x2050) for (i = 0; i < 3; i++) to[i] = mutant(desk->position[i], &bad_frame);
    else if (what == 0x2051) for (i = 0; i < 3; i++) to[i] = mutant(desk->velocity[i], &unused);
    else if (what == 0x2052) for (i = 0; i < 16; i++) to[i] = mutant(desk->transform[i], i % 4 < 3 && i < 12 ? &bad_frame : &unused);
    else if (what == 0x2551) memcpy(to, desk->workspace, sizeof desk->workspace);
    else if (what == 0x2603) *to = desk->most_force;
    else if (what == 0x2605) for (i = 0; i < 6; i++) to[i] = i == 2 ? desk->warmth : 0.1;
    else push(0x100);
    if (what == 0x2605 && desk->warmth >= 1) push(0x200);
}

void hdSetDoublev(unsigned int what, const double *from) {
    if (what != 0x2700) push(0x100);
    else if (!in_frame[now_at]) push(0x402);
    else memcpy(force[now_at], from, sizeof force[now_at]);
}

const char *hdGetString(unsigned int what) { return what == 0x2501 ? "Touch" : "2007"; }

unsigned int hdCheckCalibration(void) {
    if (seed == 0 || draw() % 20) return desk->calibration;
    unsigned int code = draw() % 2 ? 0x5000 + draw() % 4 : draw();
    if (code != 0x5000) bad_frame = 1;
    return code;
}

void hdUpdateCalibration(unsigned int style) { if (style == desk->style) desk->calibration = 0x5000; else push(0x102); }

void hdSetSchedulerRate(unsigned long rate) {
    if (refused("hdSetSchedulerRate")) return;
    if (rate < 100 || rate > 4000) push(0x101); else period_s = 1.0 / rate;
}

static void call_all(void) {
    for (int i = 0; i < 8; i++) {
        if (tasks[i].call == NULL) continue;
        double begun = now();
        int64_t before = desk->count;
        unsigned int code = tasks[i].call(tasks[i].data);
        if (desk->count > before) desk->rows[before % ROWS].spent_s = now() - begun;
        if (code == 0) tasks[i].call = NULL, tasks[i].over = 1;
    }
    pthread_cond_broadcast(&over);
}

static void *run(void *nothing) {
    double next = now();
    while (running) {
        while (running && desk->stuck) usleep(1000);
        pthread_mutex_lock(&lock);
        call_all();
        pthread_mutex_unlock(&lock);
        next = fmax(next + period_s, now());
        struct timespec until = {(time_t)next, (long)((next - floor(next)) * 1e9)};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
    }
    return NULL;
}

void hdStartScheduler(void) {
    if (refused("hdStartScheduler")) return;
    running = 1;
    pthread_create(&thread, NULL, run, NULL);
    struct sched_param before_others = {1}; /* as the vendor's; where that is not allowed, without */
    pthread_setschedparam(thread, SCHED_FIFO, &before_others);
}

void hdStopScheduler(void) {
    if (!running) return;
    running = 0;
    pthread_join(thread, NULL);
    memset(tasks, 0, sizeof tasks);
}

static int add(callback call, void *data, int once) {
    for (int i = 0; i < 8; i++)
        if (tasks[i].call == NULL) {
            tasks[i] = (struct task){call, data, ++handles, once, 0};
            return i;
        }
    push(0x501);
    return -1;
}

unsigned long hdScheduleAsynchronous(callback call, void *data, unsigned short priority) {
    if (refused("hdScheduleAsynchronous")) return 0xFFFFFFFF;
    pthread_mutex_lock(&lock);
    int place = add(call, data, 0);
    pthread_mutex_unlock(&lock);
    return place < 0 ? 0xFFFFFFFF : tasks[place].handle;
}

void hdScheduleSynchronous(callback call, void *data, unsigned short priority) {
    pthread_mutex_lock(&lock);
    int place = add(call, data, 1);
    while (running && !tasks[place].over) pthread_cond_wait(&over, &lock);
    pthread_mutex_unlock(&lock);
}

void hdUnschedule(unsigned long handle) {
    pthread_mutex_lock(&lock);
    int found = 0;
    for (int i = 0; i < 8; i++)
        if (tasks[i].call && tasks[i].handle == handle) tasks[i].call = NULL, found = 1;
    if (!found) push(0x104);
    pthread_mutex_unlock(&lock);
}

/* For tests: runs a number of periods at once in the calling thread; a seed other than 0 mutates return values. */
void run_mutated(int count, uint64_t with) {
    pthread_mutex_lock(&lock);
    seed = with;
    while (count--) call_all();
    seed = 0;
    pthread_mutex_unlock(&lock);
}
