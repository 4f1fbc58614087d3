/* Prints the messages of publish.c, from before its start to its end. */
#include <inttypes.h>
#include <stdio.h>

#include <conduit_ring.h>

static int failed(const char *what) {
    fprintf(stderr, "subscribe: %s: %s\n", what, conduit_ring_last_error());
    return 1;
}

static void print(const conduit_ring_message *message) {
    const conduit_ring_meta meta = conduit_ring_message_meta(message);
    printf("%" PRIu64 ": %.*s (%" PRIu64 " lost before)\n", meta.sequence, (int)meta.size_bytes,
           (const char *)conduit_ring_message_data(message), meta.lost);
}

int main(void) {
    conduit_ring_subscriber *subscriber;
    conduit_ring_message *message;
    if (conduit_ring_subscriber_open("numbers", NULL, &subscriber) < 0) return failed("open");
    if (conduit_ring_message_new(&message) < 0) return failed("message");

    uint32_t event = 0;
    while (event != CONDUIT_RING_EVENT_PUBLISHER_DOWN) {
        if (conduit_ring_subscriber_read(subscriber, message, CONDUIT_RING_FOREVER, &event) < 0)
            return failed("read");
        if (event == CONDUIT_RING_EVENT_MESSAGE) print(message);
    }
    conduit_ring_message_free(message);
    conduit_ring_subscriber_close(subscriber);
    return 0;
}
