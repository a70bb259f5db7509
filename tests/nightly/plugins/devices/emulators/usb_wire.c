/* The functions of libusb 1.0 that transfer without waiting, over the sockets of usb_wire.py: one for each endpoint. */

#define _GNU_SOURCE
#include <errno.h>
#include <poll.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

enum { WRITE = 1, READ = 2 };          /* of usb_wire.py */
enum { OK = 0, SILENT = 1, GONE = 2 }; /* of usb_wire.py */
enum { COMPLETED = 0, ERROR = 1, CANCELLED = 3, NO_DEVICE = 5 };
enum { ENDS = 256, PER_END = 4, WAIT_MS = 20 };

struct transfer {
    void *device;
    uint8_t flags, endpoint, type;
    unsigned timeout;
    int status, length, actual_length;
    void *callback, *user_data;
    unsigned char *buffer;
    int packets;
};

static int wires[ENDS]; /* 0: not connected */
static struct transfer *queues[ENDS][PER_END];

void *libusb_alloc_transfer(int packets) { return calloc(1, sizeof(struct transfer)); }

void libusb_free_transfer(struct transfer *transfer) { free(transfer); }

static int ask(struct transfer *transfer) {
    unsigned char message[9 + 4096] = {0};
    uint32_t wait = WAIT_MS;
    int in = transfer->endpoint & 0x80, size = in ? 0 : transfer->length;
    message[0] = in ? READ : WRITE;
    message[1] = transfer->endpoint;
    memcpy(message + 5, &wait, 4);
    memcpy(message + 9, transfer->buffer, size);
    return send(wires[transfer->endpoint], message, 9 + size, MSG_NOSIGNAL) < 0;
}

int libusb_submit_transfer(struct transfer *transfer) {
    int end = transfer->endpoint, k = 0;
    if (!wires[end]) {
        struct sockaddr_un at = {.sun_family = AF_UNIX};
        strncpy(at.sun_path, getenv("HAPSCENE_USB"), sizeof at.sun_path - 1);
        wires[end] = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
        if (connect(wires[end], (struct sockaddr *)&at, sizeof at)) return -4;
    }
    while (k < PER_END && queues[end][k]) k++;
    if (k == PER_END || ask(transfer)) return -4;
    queues[end][k] = transfer;
    return 0;
}

static void finish(int end, int status) {
    queues[end][0]->status = status;
    memmove(queues[end], queues[end] + 1, (PER_END - 1) * sizeof queues[end][0]);
    queues[end][PER_END - 1] = NULL;
}

static int take(int end) {
    unsigned char answer[1 + 4096];
    int taken = 0;
    while (queues[end][0]) {
        struct transfer *transfer = queues[end][0];
        ssize_t size = recv(wires[end], answer, sizeof answer, MSG_DONTWAIT);
        if (size < 0 && (errno == EAGAIN || errno == EINTR)) break;
        if (size > 0 && answer[0] == SILENT) {
            if (!ask(transfer)) continue;
            size = 0;
        }
        if (size > 0 && answer[0] == OK) {
            int count = end & 0x80 ? (int)size - 1 : transfer->length;
            transfer->actual_length = count < transfer->length ? count : transfer->length;
            if (end & 0x80) memcpy(transfer->buffer, answer + 1, transfer->actual_length);
            finish(end, COMPLETED);
        } else
            finish(end, size <= 0 || answer[0] == GONE ? NO_DEVICE : ERROR);
        taken = 1;
    }
    return taken;
}

int libusb_handle_events_timeout_completed(void *context, struct timeval *time, int *completed) {
    int taken = 0, count = 0;
    struct pollfd files[8];
    for (int end = 0; end < ENDS; end++)
        if (queues[end][0]) {
            taken |= take(end);
            if (queues[end][0] && count < 8) files[count++] = (struct pollfd){wires[end], POLLIN, 0};
        }
    if (!taken && (time->tv_sec || time->tv_usec)) {
        struct timespec wait = {time->tv_sec, 1000 * time->tv_usec};
        ppoll(files, count, &wait, NULL);
        for (int end = 0; end < ENDS; end++)
            if (queues[end][0]) take(end);
    }
    return 0;
}

int libusb_cancel_transfer(struct transfer *transfer) {
    int end = transfer->endpoint;
    int pending = queues[end][0] != NULL;
    if (wires[end]) close(wires[end]);
    wires[end] = 0;
    while (queues[end][0]) finish(end, CANCELLED);
    return pending ? 0 : -5;
}
