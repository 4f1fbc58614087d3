/*
 * usage: peer publish TOPIC COUNT    prints "open", waits for a line, publishes messages
 *                                    0..COUNT, waits for the end of input
 *        peer subscribe TOPIC COUNT  prints "ready", reads messages 0..COUNT, prints "whole"
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <conduit_ring.h>

#include "checked.h"

static void check(int holds, const char *what) {
    if (holds) return;
    fprintf(stderr, "peer.c: %s; last error: %s\n", what, conduit_ring_last_error());
    exit(1);
}

static void say(const char *line) {
    puts(line);
    fflush(stdout);
}

static void publish(const char *topic, uint64_t count) {
    conduit_ring_publisher_options options = CONDUIT_RING_PUBLISHER_OPTIONS_INIT;
    check(conduit_ring_geometry_depth(1024, CHECKED_LONGEST, &options.geometry) == 0, "geometry");
    conduit_ring_publisher *publisher;
    check(conduit_ring_publisher_open(topic, &options, &publisher) == 0, "open");
    say("open");
    getchar();
    for (uint64_t n = 0; n < count; ++n) {
        unsigned char message[CHECKED_LONGEST];
        const size_t size = checked_fill(message, n);
        const conduit_ring_part parts[] = {{message, 16}, {message + 16, size - 16}};
        uint64_t sequence;
        check(conduit_ring_publisher_publish_parts(publisher, parts, 2, &sequence) == 0,
            "publish");
        check(sequence == n, "sequence");
    }
    while (getchar() != EOF) {
    }
    conduit_ring_publisher_close(publisher);
}

static void subscribe(const char *topic, uint64_t count) {
    conduit_ring_subscriber *subscriber;
    conduit_ring_message *message;
    check(conduit_ring_subscriber_open(topic, NULL, &subscriber) == 0, "open");
    check(conduit_ring_message_new(&message) == 0, "message");
    say("ready");
    for (uint64_t expected = 0; expected < count; ++expected) {
        uint32_t event;
        check(conduit_ring_subscriber_read(subscriber, message, CONDUIT_RING_FOREVER, &event)
            == 0, "read");
        check(event == CONDUIT_RING_EVENT_MESSAGE, "a message, no other event");
        const conduit_ring_meta meta = conduit_ring_message_meta(message);
        uint64_t n = 0;
        check(checked_is_whole(conduit_ring_message_data(message), meta.size_bytes, &n), "torn");
        check(n == expected && meta.sequence == expected && meta.lost == 0, "not the next one");
    }
    say("whole");
    conduit_ring_message_free(message);
    conduit_ring_subscriber_close(subscriber);
}

int main(int argc, char **argv) {
    if (argc != 4) return 2;
    const uint64_t count = strtoull(argv[3], NULL, 10);
    if (strcmp(argv[1], "publish") == 0) publish(argv[2], count);
    else subscribe(argv[2], count);
    return 0;
}
