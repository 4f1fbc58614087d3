/* Publishes ten numbered messages on the topic "numbers", each from two parts. */
#define _POSIX_C_SOURCE 200809L

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include <conduit_ring.h>

static int failed(const char *what) {
    fprintf(stderr, "publish: %s: %s\n", what, conduit_ring_last_error());
    return 1;
}

int main(void) {
    conduit_ring_publisher_options options = CONDUIT_RING_PUBLISHER_OPTIONS_INIT;
    if (conduit_ring_geometry_depth(32, 200, &options.geometry) < 0) return failed("geometry");
    options.content = "text/plain";

    conduit_ring_publisher *publisher;
    if (conduit_ring_publisher_open("numbers", &options, &publisher) < 0) return failed("open");

    for (int number = 0; number < 10; ++number) {
        char digits[16];
        snprintf(digits, sizeof digits, "%d", number);
        const conduit_ring_part parts[] = {{"number ", 7}, {digits, strlen(digits)}};
        uint64_t sequence;
        if (conduit_ring_publisher_publish_parts(publisher, parts, 2, &sequence) < 0)
            return failed("publish");
        printf("published message %" PRIu64 "\n", sequence);
        const struct timespec pause = {.tv_sec = 0, .tv_nsec = 200000000};
        nanosleep(&pause, NULL);
    }
    conduit_ring_publisher_close(publisher);
    return 0;
}
