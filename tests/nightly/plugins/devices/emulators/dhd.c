/* Emulates the functions of DHD that the driver uses: status, watchdog, error codes. */
#include "desk.h"

enum { POWER, CONNECTED, STARTED, RESET, IDLE, FORCE, BRAKE, TORQUE, WRIST, FAULT, GRAVITY, GUARD, INIT, TWICE, CAUSE };
static int last, bad, expert;

static int refused(const char *function) {
    if (strcmp(desk->refuse, function)) return 0;
    last = desk->refuse_code;
    return 1;
}

static int mutated(int good) {
    if (seed == 0 || draw() % 20) return good;
    int code = draw() % 2 ? -1 : (int)draw();
    if (code < 0) bad = 1, last = draw() % 40;
    return code;
}

/* Watchdog of the device: removes the force if the servo sends nothing in time. Tests call it after killing a servo. */
void watch(void) {
    attach();
    if (desk->count == 0 || desk->watchdog == 0 || !desk->status[FORCE]) return;
    double end = desk->rows[(desk->count - 1) % ROWS].t_s + 125e-6 * desk->watchdog;
    if (now() < end) return;
    desk->status[FORCE] = 0, desk->status[CAUSE] = 3;
    note(0, 0, 0, 0, 0);
    desk->rows[(desk->count - 1) % ROWS].t_s = end;
}

void mutate(uint64_t with) { seed = with; }

int dhdGetDeviceCount(void) { attach(); return desk->style; }
int dhdErrorGetLast(void) { return last; }
const char *dhdErrorGetStr(int code) { return code == 5 ? "no device" : code == 2 ? "communication" : NULL; }
int dhdEnableExpertMode(void) { return expert = 1, 0; }

int dhdOpenID(char id) {
    attach();
    if (refused("dhdOpenID") || id >= desk->style) return last = desk->refuse_code ? desk->refuse_code : 5, -1;
    desk->started = 1, expert = 0;
    return id;
}

int dhdClose(char id) { desk->started = 0, desk->disabled++; return 0; }
int dhdStop(char id) { log_call("stop"); desk->status[FORCE] = 0; return 0; }

int dhdGetStatus(int *status, char id) {
    watch();
    if (refused("dhdGetStatus")) return -1;
    for (int i = 0; i < 16; i++) {
        status[i] = seed && draw() % 300 == 0 ? (int)draw() % 3 : desk->status[i];
        if (i == POWER || i == CONNECTED || i == FORCE ? !status[i] : (i == RESET || i == FAULT || i == BRAKE) && status[i])
            bad = 1;
    }
    return mutated(0);
}

int dhdGetPosition(double *x, double *y, double *z, char id) {
    bad = 0;
    if (refused("dhdGetPosition")) return -1;
    *x = mutant(desk->position[0], &bad), *y = mutant(desk->position[1], &bad), *z = mutant(desk->position[2], &bad);
    return mutated(desk->end_error); /* 1: not a new one */
}

static int unused;

int dhdGetLinearVelocity(double *x, double *y, double *z, char id) {
    *x = mutant(desk->velocity[0], &unused), *y = mutant(desk->velocity[1], &unused), *z = mutant(desk->velocity[2], &unused);
    return 0;
}

int dhdHasWrist(char id) { return desk->transform[15] != 0; }
int dhdHasGripper(char id) { return desk->gripper != 0; }
int dhdGetGripperAngleRad(double *angle, char id) { return *angle = mutant(desk->gripper, &unused), 0; }

int dhdGetOrientationFrame(double R[3][3], char id) {
    for (int i = 0; i < 9; i++) R[i / 3][i % 3] = mutant(desk->transform[4 * (i % 3) + i / 3], &unused); /* column-major */
    return 0;
}

unsigned int dhdGetButtonMask(char id) { return seed ? draw() : desk->buttons; }

int dhdSetForce(double x, double y, double z, char id) {
    watch();
    if (refused("dhdSetForce")) return -1;
    if (!desk->status[FORCE]) x = y = z = 0;
    note(x, y, z, desk->status[FORCE], bad);
    int code = desk->saturated ? 2 : 0, before = bad;
    code = mutated(code);
    bad = before;
    return code;
}

int dhdEnableForce(unsigned char on, char id) {
    log_call(on ? "force" : "off");
    if (!desk->off) desk->status[FORCE] = on, desk->status[CAUSE] = 0;
    return 0;
}

int dhdSetGravityCompensation(int on, char id) { log_call(on ? "gravity" : "weight"); return refused("dhdSetGravityCompensation") ? -1 : 0; }
int dhdSetWatchdog(unsigned char steps, char id) { desk->watchdog = steps; return 0; }
int dhdSetMaxForce(double most, char id) { desk->most_force = most; return 0; }
int dhdSetTimeGuard(int us, char id) { return us == 0 && expert ? 0 : -1; }
