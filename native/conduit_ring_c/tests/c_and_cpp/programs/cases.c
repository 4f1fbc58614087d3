/* usage: cases NAME TOPIC - runs one case; the exit status is 0 if it passes. */
#define _POSIX_C_SOURCE 200809L

#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#include <conduit_ring.h>

#include "wire_format.h"

#define FAIL(condition) \
    (fprintf(stderr, "line %d: %s; last error: %s\n", __LINE__, condition, \
             conduit_ring_last_error()), \
     exit(1))
#define CHECK(condition) ((condition) ? (void)0 : FAIL(#condition))
#define FAILS(errno_, message, call) \
    (CHECK((call) == -(errno_)), CHECK(strstr(conduit_ring_last_error(), (message)) != NULL))
#define MS UINT64_C(1000000)
#define LONG (10000 * MS)

_Static_assert(sizeof(conduit_ring_part) == sizeof(struct iovec), "a part is an iovec");
_Static_assert(offsetof(conduit_ring_part, data) == offsetof(struct iovec, iov_base),
    "a part is an iovec");
_Static_assert(offsetof(conduit_ring_part, size_bytes) == offsetof(struct iovec, iov_len),
    "a part is an iovec");

static const char *topic;

static conduit_ring_publisher *publisher_of(uint32_t slot_count, uint32_t slot_size_bytes) {
    conduit_ring_publisher_options options = CONDUIT_RING_PUBLISHER_OPTIONS_INIT;
    options.geometry.slot_count = slot_count;
    options.geometry.slot_size_bytes = slot_size_bytes;
    options.content = "text/plain";
    conduit_ring_publisher *publisher;
    CHECK(conduit_ring_publisher_open(topic, &options, &publisher) == 0);
    return publisher;
}

static conduit_ring_subscriber *subscriber_of(uint32_t start, uint32_t history, uint32_t policy) {
    conduit_ring_subscriber_options options = CONDUIT_RING_SUBSCRIBER_OPTIONS_INIT;
    options.start = start;
    options.history = history;
    options.policy = policy;
    conduit_ring_subscriber *subscriber;
    CHECK(conduit_ring_subscriber_open(topic, &options, &subscriber) == 0);
    return subscriber;
}

static conduit_ring_message *message_of_nothing(void) {
    conduit_ring_message *message;
    CHECK(conduit_ring_message_new(&message) == 0);
    return message;
}

static void publish(conduit_ring_publisher *publisher, const char *text) {
    CHECK(conduit_ring_publisher_publish(publisher, text, strlen(text), NULL) == 0);
}

static void expect_text(const conduit_ring_message *message, const char *text) {
    CHECK(conduit_ring_message_meta(message).size_bytes == strlen(text));
    CHECK(memcmp(conduit_ring_message_data(message), text, strlen(text)) == 0);
}

static void expect_event(conduit_ring_subscriber *subscriber, conduit_ring_message *message,
    uint32_t expected) {
    uint32_t event = 0;
    CHECK(conduit_ring_subscriber_read(subscriber, message, LONG, &event) == 0);
    CHECK(event == expected);
}

static void every_null_and_every_invalid_value_is_an_error_with_a_message(void) {
    CHECK(strcmp(conduit_ring_last_error(), "") == 0);
    conduit_ring_publisher *publisher = (void *)1;
    conduit_ring_subscriber *subscriber = (void *)1;
    uint32_t event;
    uint64_t u64;
    bool up;
    char bytes[8];
    conduit_ring_meta meta;
    conduit_ring_info info;
    conduit_ring_stats stats;
    conduit_ring_geometry geometry;

    FAILS(EINVAL, "topic is NULL", conduit_ring_publisher_open(NULL, NULL, &publisher));
    CHECK(publisher == NULL);
    FAILS(EINVAL, "publisher is NULL", conduit_ring_publisher_open(topic, NULL, NULL));
    FAILS(EINVAL, "expected a topic name", conduit_ring_publisher_open("a/b", NULL, &publisher));
    FAILS(EINVAL, "UTF-8", conduit_ring_publisher_open("\xff", NULL, &publisher));
    conduit_ring_publisher_options options = CONDUIT_RING_PUBLISHER_OPTIONS_INIT;
    options.geometry.slot_count = 3;
    FAILS(EINVAL, "3 slots", conduit_ring_publisher_open(topic, &options, &publisher));
    options.geometry.slot_count = 4;
    options.flags = 8;
    FAILS(EINVAL, "flags", conduit_ring_publisher_open(topic, &options, &publisher));
    FAILS(EINVAL, "publisher is NULL", conduit_ring_publisher_publish(NULL, "x", 1, NULL));
    FAILS(EINVAL, "publisher is NULL", conduit_ring_publisher_publish_parts(NULL, NULL, 0, NULL));
    FAILS(EINVAL, "publisher is NULL", conduit_ring_publisher_info(NULL, &info));
    CHECK(conduit_ring_publisher_close(NULL) == 0);
    CHECK(conduit_ring_publisher_abandon(NULL) == 0);

    FAILS(EINVAL, "topic is NULL", conduit_ring_subscriber_open(NULL, NULL, &subscriber));
    CHECK(subscriber == NULL);
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_open(topic, NULL, NULL));
    conduit_ring_subscriber_options how = CONDUIT_RING_SUBSCRIBER_OPTIONS_INIT;
    how.start = 9;
    FAILS(EINVAL, "invalid start", conduit_ring_subscriber_open(topic, &how, &subscriber));
    how.start = 0;
    how.policy = 9;
    FAILS(EINVAL, "invalid policy", conduit_ring_subscriber_open(topic, &how, &subscriber));
    how.policy = 0;
    how.guard = 9;
    FAILS(EINVAL, "invalid guard", conduit_ring_subscriber_open(topic, &how, &subscriber));
    conduit_ring_message *message = message_of_nothing();
    FAILS(EINVAL, "message is NULL", conduit_ring_message_new(NULL));
    conduit_ring_lease *lease = (void *)1;
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_lease(NULL, 0, &lease, &event));
    CHECK(lease == NULL && conduit_ring_lease_data(NULL) == NULL
        && !conduit_ring_lease_holds_slot(NULL));
    CHECK(conduit_ring_lease_meta(NULL).size_bytes == 0);
    conduit_ring_lease_release(NULL);
    void *lent = (void *)1;
    FAILS(EINVAL, "publisher is NULL", conduit_ring_publisher_loan(NULL, 1, &lent));
    CHECK(lent == NULL);
    FAILS(EINVAL, "publisher is NULL", conduit_ring_publisher_commit(NULL, 1, NULL));
    FAILS(EINVAL, "publisher is NULL", conduit_ring_publisher_cancel(NULL));
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_try_read(NULL, message, &event));
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_read(NULL, message, 0, &event));
    FAILS(EINVAL, "subscriber is NULL",
        conduit_ring_subscriber_try_read_into(NULL, bytes, 8, &meta, &event));
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_wait(NULL, 0));
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_await_topic(NULL, 0));
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_set_policy(NULL, 0));
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_publisher_up(NULL, &up));
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_geometry(NULL, &geometry));
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_content_tag(NULL, &u64));
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_stats(NULL, &stats));
    conduit_ring_waker *waker = (void *)1;
    FAILS(EINVAL, "subscriber is NULL", conduit_ring_subscriber_waker(NULL, &waker));
    CHECK(waker == NULL);
    FAILS(EINVAL, "waker is NULL", conduit_ring_waker_wake(NULL));
    CHECK(conduit_ring_subscriber_close(NULL) == 0);
    conduit_ring_waker_free(NULL);
    conduit_ring_message_free(NULL);
    CHECK(conduit_ring_message_data(NULL) == NULL);
    CHECK(conduit_ring_message_meta(NULL).size_bytes == 0);

    publisher = publisher_of(4, 64);
    subscriber = subscriber_of(0, 0, 0);
    const conduit_ring_part lost_part = {NULL, 1};
    FAILS(EINVAL, "data is NULL", conduit_ring_publisher_publish(publisher, NULL, 1, NULL));
    FAILS(EINVAL, "invalid size of data",
        conduit_ring_publisher_publish(publisher, "x", SIZE_MAX, NULL));
    FAILS(EINVAL, "parts is NULL",
        conduit_ring_publisher_publish_parts(publisher, NULL, 1, NULL));
    FAILS(EINVAL, "data of a part is NULL",
        conduit_ring_publisher_publish_parts(publisher, &lost_part, 1, NULL));
    FAILS(EINVAL, "info is NULL", conduit_ring_publisher_info(publisher, NULL));
    FAILS(EINVAL, "data is NULL", conduit_ring_publisher_loan(publisher, 1, NULL));
    FAILS(EINVAL, "no loan", conduit_ring_publisher_commit(publisher, 0, NULL));
    FAILS(EINVAL, "lease is NULL", conduit_ring_subscriber_lease(subscriber, 0, NULL, &event));
    FAILS(EINVAL, "event is NULL", conduit_ring_subscriber_lease(subscriber, 0, &lease, NULL));
    FAILS(EINVAL, "message is NULL", conduit_ring_subscriber_try_read(subscriber, NULL, &event));
    FAILS(EINVAL, "event is NULL", conduit_ring_subscriber_try_read(subscriber, message, NULL));
    FAILS(EINVAL, "event is NULL", conduit_ring_subscriber_read(subscriber, message, 0, NULL));
    FAILS(EINVAL, "buffer is NULL",
        conduit_ring_subscriber_try_read_into(subscriber, NULL, 8, &meta, &event));
    FAILS(EINVAL, "meta is NULL",
        conduit_ring_subscriber_try_read_into(subscriber, bytes, 8, NULL, &event));
    FAILS(EINVAL, "got: 7", conduit_ring_subscriber_set_policy(subscriber, 7));
    FAILS(EINVAL, "up is NULL", conduit_ring_subscriber_publisher_up(subscriber, NULL));
    FAILS(EINVAL, "geometry is NULL", conduit_ring_subscriber_geometry(subscriber, NULL));
    FAILS(EINVAL, "content_tag is NULL", conduit_ring_subscriber_content_tag(subscriber, NULL));
    FAILS(EINVAL, "stats is NULL", conduit_ring_subscriber_stats(subscriber, NULL));
    FAILS(EINVAL, "waker is NULL", conduit_ring_subscriber_waker(subscriber, NULL));
    FAILS(EINVAL, "topic is NULL", conduit_ring_topic_info(NULL, &info));
    FAILS(EINVAL, "info is NULL", conduit_ring_topic_info(topic, NULL));
    FAILS(EINVAL, "geometry is NULL", conduit_ring_geometry_slots(4, 64, NULL));
    FAILS(EINVAL, "3 slots", conduit_ring_geometry_slots(3, 64, &geometry));
    FAILS(EINVAL, "depth of 0", conduit_ring_geometry_depth(0, 64, &geometry));
    conduit_ring_publisher *second = publisher;
    FAILS(EBUSY, "publishes this topic", conduit_ring_publisher_open(topic, NULL, &second));
    CHECK(second == NULL);
    conduit_ring_publisher_close(publisher);
    conduit_ring_subscriber_close(subscriber);
    conduit_ring_message_free(message);
}

static void options_of_another_version_are_an_error(void) {
    CHECK(conduit_ring_abi_version() == CONDUIT_RING_ABI_VERSION);
    CHECK(strchr(conduit_ring_version(), '.') != NULL);
    conduit_ring_publisher_options zeros = {0};
    conduit_ring_publisher *publisher;
    FAILS(EINVAL, "got: 0", conduit_ring_publisher_open(topic, &zeros, &publisher));
    conduit_ring_subscriber_options newer = CONDUIT_RING_SUBSCRIBER_OPTIONS_INIT;
    newer.abi_version += 1;
    conduit_ring_subscriber *subscriber;
    FAILS(EINVAL, "got: 3", conduit_ring_subscriber_open(topic, &newer, &subscriber));
}

static void messages_of_one_part_and_of_many_arrive_whole(void) {
    conduit_ring_publisher *publisher = publisher_of(16, 256);
    conduit_ring_subscriber *subscriber = subscriber_of(0, 0, 0);
    conduit_ring_message *message = message_of_nothing();
    uint64_t sequence = 99;
    CHECK(conduit_ring_publisher_publish(publisher, "one", 3, &sequence) == 0);
    CHECK(sequence == 0);
    const conduit_ring_part two[] = {{"tw", 2}, {"o", 1}};
    CHECK(conduit_ring_publisher_publish_parts(publisher, two, 2, &sequence) == 0);
    CHECK(sequence == 1);
    conduit_ring_part many[20];
    for (int i = 0; i < 20; ++i) many[i] = (conduit_ring_part){"abcdefghijklmnopqrst" + i, 1};
    CHECK(conduit_ring_publisher_publish_parts(publisher, many, 20, &sequence) == 0);
    CHECK(conduit_ring_publisher_publish_parts(publisher, NULL, 0, NULL) == 0);
    CHECK(conduit_ring_publisher_publish(publisher, NULL, 0, NULL) == 0);

    const char *expected[] = {"one", "two", "abcdefghijklmnopqrst", "", ""};
    for (uint64_t i = 0; i < 5; ++i) {
        expect_event(subscriber, message, CONDUIT_RING_EVENT_MESSAGE);
        expect_text(message, expected[i]);
        const conduit_ring_meta meta = conduit_ring_message_meta(message);
        CHECK(meta.sequence == i && meta.lost == 0);
        CHECK(meta.timestamp_ns > 0 && meta.timestamp_ns <= conduit_ring_clock_now_ns());
    }
    uint32_t event = 77;
    CHECK(conduit_ring_subscriber_try_read(subscriber, message, &event) == -EAGAIN);
    CHECK(event == 77 && conduit_ring_message_meta(message).size_bytes == 0);
    conduit_ring_message_free(message);
    conduit_ring_subscriber_close(subscriber);
    conduit_ring_publisher_close(publisher);
}

static void a_message_that_does_not_fit_is_rejected_and_counted(void) {
    conduit_ring_publisher *publisher = publisher_of(4, 64);
    char bytes[64] = {0};
    const uint32_t longest = 64 - CONDUIT_RING_SLOT_HEADER_BYTES;
    FAILS(EMSGSIZE, "a slot holds 44",
        conduit_ring_publisher_publish(publisher, bytes, longest + 1, NULL));
    CHECK(conduit_ring_publisher_publish(publisher, bytes, longest, NULL) == 0);
    conduit_ring_info info;
    CHECK(conduit_ring_publisher_info(publisher, &info) == 0);
    CHECK(info.published == 1 && info.rejected_oversize == 1
        && info.max_message_size_bytes == longest);
    conduit_ring_publisher_close(publisher);
}

static void a_message_too_large_for_the_callers_buffer_is_kept(void) {
    conduit_ring_publisher *publisher = publisher_of(4, 64);
    conduit_ring_subscriber *subscriber = subscriber_of(0, 0, 0);
    conduit_ring_message *message = message_of_nothing();
    conduit_ring_meta meta;
    uint32_t event;
    char buffer[8];
    CHECK(conduit_ring_subscriber_try_read_into(subscriber, buffer, 4, &meta, &event) == -EAGAIN);
    for (int round = 0; round < 3; ++round) {
        publish(publisher, "sixsix");
        FAILS(ENOBUFS, "message of 6 bytes",
            conduit_ring_subscriber_try_read_into(subscriber, buffer, 4, &meta, &event));
        CHECK(meta.size_bytes == 6);
        FAILS(ENOBUFS, "message of 6 bytes",
            conduit_ring_subscriber_try_read_into(subscriber, NULL, 0, &meta, &event));
        CHECK(conduit_ring_subscriber_wait(subscriber, 0) == 0);
        if (round == 0) {
            expect_event(subscriber, message, CONDUIT_RING_EVENT_MESSAGE);
            expect_text(message, "sixsix");
        } else {
            CHECK(conduit_ring_subscriber_try_read_into(subscriber, buffer, 6, &meta, &event)
                == 0);
            CHECK(event == CONDUIT_RING_EVENT_MESSAGE && memcmp(buffer, "sixsix", 6) == 0);
        }
        CHECK(conduit_ring_subscriber_try_read_into(subscriber, buffer, 8, &meta, &event)
            == -EAGAIN);
    }
    publish(publisher, "four");
    CHECK(conduit_ring_subscriber_try_read_into(subscriber, buffer, 8, &meta, &event) == 0);
    CHECK(meta.size_bytes == 4 && meta.sequence == 3 && memcmp(buffer, "four", 4) == 0);
    publish(publisher, "");
    CHECK(conduit_ring_subscriber_try_read_into(subscriber, NULL, 0, &meta, &event) == 0);
    CHECK(meta.size_bytes == 0 && meta.sequence == 4);
    conduit_ring_message_free(message);
    conduit_ring_subscriber_close(subscriber);
    conduit_ring_publisher_close(publisher);
}

static void a_publishers_start_and_end_are_events(void) {
    conduit_ring_subscriber *subscriber = subscriber_of(0, 0, 0);
    conduit_ring_message *message = message_of_nothing();
    conduit_ring_geometry geometry;
    uint64_t tag;
    bool up = true;
    CHECK(conduit_ring_subscriber_await_topic(subscriber, 5 * MS) == -ETIMEDOUT);
    CHECK(conduit_ring_subscriber_publisher_up(subscriber, &up) == 0 && !up);
    FAILS(ENOENT, topic, conduit_ring_subscriber_geometry(subscriber, &geometry));
    FAILS(ENOENT, topic, conduit_ring_subscriber_content_tag(subscriber, &tag));

    conduit_ring_publisher *publisher = publisher_of(8, 128);
    CHECK(conduit_ring_subscriber_await_topic(subscriber, LONG) == 0);
    publish(publisher, "last words");
    expect_event(subscriber, message, CONDUIT_RING_EVENT_PUBLISHER_UP);
    CHECK(conduit_ring_subscriber_publisher_up(subscriber, &up) == 0 && up);
    CHECK(conduit_ring_subscriber_geometry(subscriber, &geometry) == 0);
    CHECK(geometry.slot_count == 8 && geometry.slot_size_bytes == 128);
    CHECK(conduit_ring_subscriber_content_tag(subscriber, &tag) == 0);
    CHECK(tag == conduit_ring_content_tag("text/plain"));
    conduit_ring_publisher_close(publisher);
    expect_event(subscriber, message, CONDUIT_RING_EVENT_MESSAGE);
    expect_text(message, "last words");
    expect_event(subscriber, message, CONDUIT_RING_EVENT_PUBLISHER_DOWN);

    publisher = publisher_of(4, 64);
    publish(publisher, "again");
    expect_event(subscriber, message, CONDUIT_RING_EVENT_PUBLISHER_UP);
    expect_event(subscriber, message, CONDUIT_RING_EVENT_MESSAGE);
    expect_text(message, "again");
    conduit_ring_message_free(message);
    conduit_ring_subscriber_close(subscriber);
    conduit_ring_publisher_close(publisher);
}

static void an_abandoned_topic_is_taken_over_at_the_same_number(void) {
    conduit_ring_publisher *publisher = publisher_of(8, 128);
    publish(publisher, "a");
    conduit_ring_publisher_abandon(publisher);
    conduit_ring_info info;
    CHECK(conduit_ring_topic_info(topic, &info) == 0);
    CHECK(info.state == CONDUIT_RING_STATE_DEAD && info.epoch == 0);
    publisher = publisher_of(8, 128);
    uint64_t sequence;
    CHECK(conduit_ring_publisher_publish(publisher, "b", 1, &sequence) == 0);
    CHECK(sequence == 1);
    CHECK(conduit_ring_publisher_info(publisher, &info) == 0);
    CHECK(info.epoch == 1 && info.state == CONDUIT_RING_STATE_LIVE);
    conduit_ring_publisher_close(publisher);
    FAILS(ENOENT, topic, conduit_ring_topic_info(topic, &info));
}

static void history_latest_and_losses(void) {
    conduit_ring_publisher *publisher = publisher_of(4, 64);
    conduit_ring_subscriber *all =
        subscriber_of(CONDUIT_RING_START_NEW, 0, CONDUIT_RING_POLICY_ALL);
    for (char c = 'a'; c < 'k'; ++c)
        CHECK(conduit_ring_publisher_publish(publisher, &c, 1, NULL) == 0);
    conduit_ring_message *message = message_of_nothing();
    expect_event(all, message, CONDUIT_RING_EVENT_MESSAGE);
    expect_text(message, "g");
    CHECK(conduit_ring_message_meta(message).lost == 6);
    CHECK(conduit_ring_subscriber_set_policy(all, CONDUIT_RING_POLICY_LATEST) == 0);
    expect_event(all, message, CONDUIT_RING_EVENT_MESSAGE);
    expect_text(message, "j");
    conduit_ring_stats stats;
    CHECK(conduit_ring_subscriber_stats(all, &stats) == 0);
    CHECK(stats.delivered == 2 && stats.lost == 8 && stats.resyncs == 0);

    conduit_ring_subscriber *latest =
        subscriber_of(CONDUIT_RING_START_LATEST, 0, CONDUIT_RING_POLICY_ALL);
    expect_event(latest, message, CONDUIT_RING_EVENT_MESSAGE);
    expect_text(message, "j");
    conduit_ring_subscriber *history =
        subscriber_of(CONDUIT_RING_START_HISTORY, 3, CONDUIT_RING_POLICY_ALL);
    expect_event(history, message, CONDUIT_RING_EVENT_MESSAGE);
    expect_text(message, "h");
    conduit_ring_message_free(message);
    conduit_ring_subscriber_close(all);
    conduit_ring_subscriber_close(latest);
    conduit_ring_subscriber_close(history);
    conduit_ring_publisher_close(publisher);
}

static void *wake(void *waker) {
    CHECK(conduit_ring_waker_wake(waker) == 0);
    return NULL;
}

static void waiting_ends_in_time_and_by_the_waker(void) {
    conduit_ring_publisher *publisher = publisher_of(4, 64);
    conduit_ring_subscriber *subscriber = subscriber_of(0, 0, 0);
    conduit_ring_message *message = message_of_nothing();
    uint32_t event;
    const uint64_t before = conduit_ring_clock_now_ns();
    CHECK(conduit_ring_subscriber_wait(subscriber, 20 * MS) == -ETIMEDOUT);
    CHECK(conduit_ring_subscriber_read(subscriber, message, 20 * MS, &event) == -ETIMEDOUT);
    CHECK(conduit_ring_clock_now_ns() - before >= 39 * MS);
    CHECK(conduit_ring_subscriber_read(subscriber, message, 0, &event) == -ETIMEDOUT);

    conduit_ring_waker *waker;
    CHECK(conduit_ring_subscriber_waker(subscriber, &waker) == 0);
    for (int way = 0; way < 2; ++way) {
        pthread_t thread;
        CHECK(pthread_create(&thread, NULL, wake, waker) == 0);
        if (way == 0)
            CHECK(conduit_ring_subscriber_wait(subscriber, CONDUIT_RING_FOREVER) == -ECANCELED);
        else
            CHECK(conduit_ring_subscriber_read(subscriber, message, CONDUIT_RING_FOREVER, &event)
                == -ECANCELED);
        CHECK(pthread_join(thread, NULL) == 0);
    }
    publish(publisher, "x");
    CHECK(conduit_ring_subscriber_wait(subscriber, CONDUIT_RING_FOREVER) == 0);
    conduit_ring_subscriber_close(subscriber);
    CHECK(conduit_ring_waker_wake(waker) == 0);
    conduit_ring_waker_free(waker);
    conduit_ring_message_free(message);
    conduit_ring_publisher_close(publisher);
}

static void *wait_for_ever(void *subscriber) {
    // The main thread may be using the subscriber at this moment, while it waits for this thread.
    int status;
    do status = conduit_ring_subscriber_wait(subscriber, CONDUIT_RING_FOREVER);
    while (status == -EALREADY);
    CHECK(status == -ECANCELED);
    return NULL;
}

static void a_subscriber_in_use_by_another_thread_is_an_error(void) {
    conduit_ring_publisher *publisher = publisher_of(4, 64);
    conduit_ring_subscriber *subscriber = subscriber_of(0, 0, 0);
    conduit_ring_waker *waker;
    CHECK(conduit_ring_subscriber_waker(subscriber, &waker) == 0);
    pthread_t thread;
    CHECK(pthread_create(&thread, NULL, wait_for_ever, subscriber) == 0);
    bool up;
    while (conduit_ring_subscriber_publisher_up(subscriber, &up) == 0) sched_yield();
    FAILS(EALREADY, "another thread", conduit_ring_subscriber_publisher_up(subscriber, &up));
    CHECK(conduit_ring_waker_wake(waker) == 0);
    CHECK(pthread_join(thread, NULL) == 0);
    CHECK(conduit_ring_subscriber_publisher_up(subscriber, &up) == 0);
    conduit_ring_waker_free(waker);
    conduit_ring_subscriber_close(subscriber);
    conduit_ring_publisher_close(publisher);
}

static void a_topic_can_be_inspected_from_outside(void) {
    conduit_ring_publisher *publisher = publisher_of(8, 256);
    conduit_ring_subscriber *subscriber = subscriber_of(0, 0, 0);
    publish(publisher, "x");
    conduit_ring_info info;
    CHECK(conduit_ring_topic_info(topic, &info) == 0);
    CHECK(info.state == CONDUIT_RING_STATE_LIVE && info.published == 1
        && info.writer_pid == (uint32_t)getpid());
    CHECK(info.geometry.slot_count == 8 && info.geometry.slot_size_bytes == 256);
    CHECK(info.max_message_size_bytes == 256 - CONDUIT_RING_SLOT_HEADER_BYTES);
    CHECK(info.content_tag == conduit_ring_content_tag("text/plain") && info.instance_id != 0);
    CHECK(info.reader_count == 1 && info.readers[0].pid == (uint32_t)getpid());
    CHECK(info.readers[0].is_native && info.readers[0].is_alive && !info.readers[0].is_waiting);
    CHECK(info.readers[0].index == 0 && info.readers[0].next_sequence == 0
        && info.readers[0].lost == 0);
    CHECK(info.last_publish_ns > 0 && info.realtime_offset_ns > 0);
    CHECK(info.dropped_pinned == 0 && info.rejected_oversize == 0 && info.wake_count == 0);
    CHECK(conduit_ring_content_tag(NULL) == 0);
    CHECK(conduit_ring_content_tag("foobar") == UINT64_C(0x85944171f73967e8));
    conduit_ring_subscriber_close(subscriber);
    conduit_ring_publisher_close(publisher);
}

static void messages_over_the_given_size_are_rejected_and_counted(void) {
    conduit_ring_geometry geometry;
    CHECK(conduit_ring_geometry_slots(4, 2100000, &geometry) == 0);
    CHECK(geometry.slot_count == 4 && geometry.slot_size_bytes == 2100000);
    CHECK(conduit_ring_geometry_depth(10, 4076, &geometry) == 0);
    CHECK(geometry.slot_count == 16 && geometry.slot_size_bytes == 4096);
    FAILS(EINVAL, "2097152 slots", conduit_ring_geometry_slots(1u << 21, 64, &geometry));
    CHECK(conduit_ring_geometry_slots(1u << 20, 64, &geometry) == 0);

    conduit_ring_info info;
    const char message[4081] = {0};
    for (int life = 0; life < 2; ++life) {
        conduit_ring_publisher *publisher = publisher_of(4, 4100);
        CHECK(conduit_ring_publisher_publish(publisher, message, 4080, NULL) == 0);
        FAILS(EMSGSIZE, "4081 bytes and a slot holds 4080",
            conduit_ring_publisher_publish(publisher, message, 4081, NULL));
        CHECK(conduit_ring_publisher_info(publisher, &info) == 0);
        CHECK(info.max_message_size_bytes == 4080 && info.geometry.slot_size_bytes == 4160);
        if (life == 0) conduit_ring_publisher_abandon(publisher);
        else conduit_ring_publisher_close(publisher);
    }
}

static void the_clock_is_the_one_that_stamps_messages(void) {
    struct timespec now;
    const uint64_t before = conduit_ring_clock_now_ns();
    CHECK(clock_gettime(4 /* CLOCK_MONOTONIC_RAW, hidden by strict C */, &now) == 0);
    const uint64_t between = (uint64_t)now.tv_sec * 1000 * MS + (uint64_t)now.tv_nsec;
    CHECK(before <= between && between <= conduit_ring_clock_now_ns());
    CHECK(clock_gettime(CLOCK_REALTIME, &now) == 0);
    const int64_t offset_ns = conduit_ring_clock_realtime_offset_ns();
    const int64_t wall_s = ((int64_t)conduit_ring_clock_now_ns() + offset_ns) / 1000000000;
    CHECK(wall_s - now.tv_sec < 60 && now.tv_sec - wall_s < 60);
}

static conduit_ring_lease *lease_of_next(conduit_ring_subscriber *subscriber, const char *text) {
    uint32_t event = 0;
    conduit_ring_lease *lease;
    CHECK(conduit_ring_subscriber_lease(subscriber, LONG, &lease, &event) == 0);
    CHECK(event == CONDUIT_RING_EVENT_MESSAGE && lease != NULL);
    CHECK(conduit_ring_lease_meta(lease).size_bytes == strlen(text));
    CHECK(memcmp(conduit_ring_lease_data(lease), text, strlen(text)) == 0);
    return lease;
}

static void a_lease_keeps_a_message_in_its_slot_until_it_is_released(void) {
    conduit_ring_publisher *publisher = publisher_of(4, 64);
    conduit_ring_subscriber *subscriber = subscriber_of(0, 0, 0);
    uint32_t event;
    conduit_ring_lease *lease;
    CHECK(conduit_ring_subscriber_lease(subscriber, 0, &lease, &event) == -ETIMEDOUT
        && lease == NULL);
    CHECK(conduit_ring_subscriber_lease(subscriber, MS, &lease, &event) == -ETIMEDOUT
        && lease == NULL);
    publish(publisher, "first");
    conduit_ring_lease_release(lease_of_next(subscriber, "first"));

    publish(publisher, "held");
    lease = lease_of_next(subscriber, "held");
    CHECK(conduit_ring_lease_holds_slot(lease));
    CHECK(conduit_ring_lease_meta(lease).sequence == 1
        && conduit_ring_lease_meta(lease).lost == 0);
    for (int i = 0; i < 3; ++i) publish(publisher, "other");
    uint64_t sequence;
    CHECK(conduit_ring_publisher_publish(publisher, "x", 1, &sequence) == 0 && sequence == 6);
    CHECK(memcmp(conduit_ring_lease_data(lease), "held", 4) == 0);
    conduit_ring_lease_release(lease);
    publish(publisher, "after");
    conduit_ring_info info;
    CHECK(conduit_ring_publisher_info(publisher, &info) == 0 && info.dropped_pinned == 1
        && info.published == 8);
    conduit_ring_subscriber_close(subscriber);
    conduit_ring_publisher_close(publisher);
}

static void a_fourth_lease_is_an_error_and_its_message_is_kept(void) {
    conduit_ring_publisher *publisher = publisher_of(16, 64);
    conduit_ring_subscriber *subscriber = subscriber_of(0, 0, 0);
    const char *const texts[] = {"one", "two", "three"};
    conduit_ring_lease *leases[3];
    for (int i = 0; i < 3; ++i) {
        publish(publisher, texts[i]);
        leases[i] = lease_of_next(subscriber, texts[i]);
    }
    publish(publisher, "four");
    uint32_t event;
    conduit_ring_lease *lease = (void *)1;
    FAILS(EMFILE, "3 leases", conduit_ring_subscriber_lease(subscriber, 0, &lease, &event));
    CHECK(lease == NULL);
    conduit_ring_lease_release(leases[1]);
    leases[1] = lease_of_next(subscriber, "four");
    conduit_ring_subscriber_close(subscriber);
    CHECK(memcmp(conduit_ring_lease_data(leases[2]), "three", 5) == 0);
    for (int i = 0; i < 3; ++i) conduit_ring_lease_release(leases[i]);
    conduit_ring_publisher_close(publisher);
}

static void a_lease_returns_events_and_starts_with_the_kept_message(void) {
    conduit_ring_subscriber *subscriber = subscriber_of(0, 0, 0);
    conduit_ring_publisher *publisher = publisher_of(16, 64);
    uint32_t event;
    conduit_ring_lease *lease = (void *)1;
    CHECK(conduit_ring_subscriber_lease(subscriber, LONG, &lease, &event) == 0);
    CHECK(event == CONDUIT_RING_EVENT_PUBLISHER_UP && lease == NULL);
    publish(publisher, "too long for it");
    publish(publisher, "next");
    char bytes[4];
    conduit_ring_meta meta;
    FAILS(ENOBUFS, "is kept",
        conduit_ring_subscriber_try_read_into(subscriber, bytes, 4, &meta, &event));
    lease = lease_of_next(subscriber, "too long for it");
    CHECK(!conduit_ring_lease_holds_slot(lease) && conduit_ring_lease_meta(lease).sequence == 0);
    conduit_ring_lease_release(lease);
    conduit_ring_lease_release(lease_of_next(subscriber, "next"));
    conduit_ring_publisher_close(publisher);
    CHECK(conduit_ring_subscriber_lease(subscriber, LONG, &lease, &event) == 0);
    CHECK(event == CONDUIT_RING_EVENT_PUBLISHER_DOWN && lease == NULL);
    conduit_ring_subscriber_close(subscriber);
}

static void a_loan_is_published_when_it_is_committed(void) {
    conduit_ring_publisher *publisher = publisher_of(4, 64);
    conduit_ring_subscriber *subscriber = subscriber_of(0, 0, 0);
    conduit_ring_message *message = message_of_nothing();
    uint32_t event;
    uint64_t sequence = 9;
    void *data, *second = (void *)1;
    FAILS(EMSGSIZE, "45", conduit_ring_publisher_loan(publisher, 45, &second));
    CHECK(second == NULL);
    CHECK(conduit_ring_publisher_loan(publisher, 44, &data) == 0);
    memcpy(data, "in place", 8);
    CHECK(conduit_ring_subscriber_try_read(subscriber, message, &event) == -EAGAIN);
    FAILS(EALREADY, "loan", conduit_ring_publisher_publish(publisher, "x", 1, NULL));
    FAILS(EALREADY, "loan", conduit_ring_publisher_publish_parts(publisher, NULL, 0, NULL));
    FAILS(EALREADY, "loan", conduit_ring_publisher_loan(publisher, 1, &second));
    FAILS(EINVAL, "44 bytes, got: 45", conduit_ring_publisher_commit(publisher, 45, NULL));
    CHECK(conduit_ring_publisher_commit(publisher, 8, &sequence) == 0 && sequence == 0);
    expect_event(subscriber, message, CONDUIT_RING_EVENT_MESSAGE);
    expect_text(message, "in place");

    CHECK(conduit_ring_publisher_loan(publisher, 5, &data) == 0);
    memcpy(data, "never", 5);
    CHECK(conduit_ring_publisher_cancel(publisher) == 0);
    CHECK(conduit_ring_publisher_cancel(publisher) == 0);
    FAILS(EINVAL, "no loan", conduit_ring_publisher_commit(publisher, 5, NULL));
    publish(publisher, "instead");
    expect_event(subscriber, message, CONDUIT_RING_EVENT_MESSAGE);
    expect_text(message, "instead");
    CHECK(conduit_ring_message_meta(message).sequence == 1
        && conduit_ring_message_meta(message).lost == 0);

    CHECK(conduit_ring_publisher_loan(publisher, 0, &data) == 0);
    CHECK(conduit_ring_publisher_commit(publisher, 0, &sequence) == 0 && sequence == 2);
    CHECK(conduit_ring_publisher_loan(publisher, 5, &data) == 0);
    conduit_ring_publisher_close(publisher);
    conduit_ring_message_free(message);
    conduit_ring_subscriber_close(subscriber);
}

static void an_ended_publisher_keeps_its_loan_and_fails_all_calls(void) {
    conduit_ring_publisher *publisher = publisher_of(4, 64);
    conduit_ring_info info;
    void *data, *second;
    FAILS(EINVAL, "NULL", conduit_ring_publisher_end(NULL));
    CHECK(conduit_ring_publisher_loan(publisher, 8, &data) == 0);
    CHECK(conduit_ring_publisher_end(publisher) == 0
        && conduit_ring_publisher_end(publisher) == 0);
    memset(data, 'x', 8);
    FAILS(ESHUTDOWN, "ended its topic", conduit_ring_publisher_commit(publisher, 8, NULL));
    FAILS(ESHUTDOWN, "ended its topic", conduit_ring_publisher_publish(publisher, "x", 1, NULL));
    FAILS(ESHUTDOWN, "ended its topic", conduit_ring_publisher_loan(publisher, 1, &second));
    FAILS(ESHUTDOWN, "ended its topic", conduit_ring_publisher_info(publisher, &info));
    CHECK(conduit_ring_publisher_cancel(publisher) == 0);

    conduit_ring_publisher *next = publisher_of(4, 64);
    publish(next, "free");
    conduit_ring_publisher_close(publisher);
    publish(next, "still");
    conduit_ring_publisher_close(next);
}

static void a_publisher_without_a_thread_is_checked_by_its_owner(void) {
    conduit_ring_publisher_options options = CONDUIT_RING_PUBLISHER_OPTIONS_INIT;
    conduit_ring_publisher *publisher, *other;
    char path[300];
    void *data;
    snprintf(path, sizeof path, "/dev/shm/conduit_%s", topic);
    options.flags = CONDUIT_RING_NO_THREAD;
    CHECK(conduit_ring_publisher_open(topic, &options, &publisher) == 0);
    FAILS(EINVAL, "publisher is NULL", conduit_ring_publisher_look_after(NULL));
    publish(publisher, "before");

    CHECK(unlink(path) == 0 && conduit_ring_publisher_look_after(publisher) == 0);
    FAILS(EBUSY, "publishes this topic", conduit_ring_publisher_open(topic, &options, &other));
    conduit_ring_info info;
    CHECK(conduit_ring_topic_info(topic, &info) == 0 && info.published == 1);

    CHECK(unlink(path) == 0 && conduit_ring_publisher_loan(publisher, 1, &data) == 0);
    FAILS(EALREADY, "loan", conduit_ring_publisher_look_after(publisher));
    CHECK(conduit_ring_publisher_cancel(publisher) == 0);
    CHECK(conduit_ring_publisher_open(topic, &options, &other) == 0);
    FAILS(ESTALE, "publishes this topic", conduit_ring_publisher_look_after(publisher));
    FAILS(ESTALE, "publishes this topic",
        conduit_ring_publisher_publish(publisher, "x", 1, NULL));
    FAILS(ESTALE, "publishes this topic", conduit_ring_publisher_loan(publisher, 1, &data));

    conduit_ring_publisher_close(other);
    CHECK(conduit_ring_publisher_look_after(publisher) == 0);
    publish(publisher, "after");
    CHECK(conduit_ring_topic_info(topic, &info) == 0 && info.published == 2);
    conduit_ring_publisher_close(publisher);
    CHECK(access(path, F_OK) != 0);
}

static void a_guarded_subscriber_survives_a_truncated_file(void) {
    conduit_ring_publisher *publisher = publisher_of(4, 8192);
    conduit_ring_subscriber_options options = CONDUIT_RING_SUBSCRIBER_OPTIONS_INIT;
    options.guard = CONDUIT_RING_GUARD_ALWAYS;
    conduit_ring_subscriber *subscriber;
    CHECK(conduit_ring_subscriber_open(topic, &options, &subscriber) == 0);
    conduit_ring_message *message = message_of_nothing();
    publish(publisher, "guarded");
    expect_event(subscriber, message, CONDUIT_RING_EVENT_MESSAGE);
    expect_text(message, "guarded");
    publish(publisher, "leased");
    conduit_ring_lease *lease = lease_of_next(subscriber, "leased");
    CHECK(!conduit_ring_lease_holds_slot(lease));
    publish(publisher, "gone");
    conduit_ring_publisher_abandon(publisher);
    char path[300];
    uint32_t event;
    snprintf(path, sizeof path, "/dev/shm/conduit_%s", topic);
    CHECK(truncate(path, 100) == 0);
    FAILS(EPROTO, "conduit_", conduit_ring_subscriber_try_read(subscriber, message, &event));
    CHECK(memcmp(conduit_ring_lease_data(lease), "leased", 6) == 0);
    conduit_ring_lease_release(lease);
    conduit_ring_message_free(message);
    conduit_ring_subscriber_close(subscriber);

    options.guard = CONDUIT_RING_GUARD_NEVER;
    CHECK(unlink(path) == 0 && conduit_ring_subscriber_open(topic, &options, &subscriber) == 0);
    conduit_ring_subscriber_close(subscriber);
}

/* The bytes in which two files of the same content differ, according to the dumps. */
static const size_t VARIES[][2] = {{32, 48}, {80, 84}, {88, 104}, {1228, 1236}, {1292, 1300}};

static void expect_segment(const char *path, const char *name) {
    unsigned char shown[2048], found[2048];
    const size_t size = wire_format_read(name, shown, sizeof shown);
    FILE *file = fopen(path, "r");
    CHECK(file != NULL && fread(found, 1, sizeof found, file) == size);
    fclose(file);
    for (size_t i = 0; i < sizeof VARIES / sizeof *VARIES; ++i) {
        memset(shown + VARIES[i][0], 0, VARIES[i][1] - VARIES[i][0]);
        memset(found + VARIES[i][0], 0, VARIES[i][1] - VARIES[i][0]);
    }
    CHECK(memcmp(shown, found, size) == 0);
}

static void a_segment_is_written_and_read_as_in_the_wire_format(void) {
    char path[300];
    snprintf(path, sizeof path, "/dev/shm/conduit_%s", topic);
    conduit_ring_publisher *publisher = publisher_of(2, 64);
    expect_segment(path, "empty_segment");
    publish(publisher, "message0");
    publish(publisher, "message1");
    publish(publisher, "message2");
    expect_segment(path, "segment");
    conduit_ring_publisher_close(publisher);

    unsigned char shown[2048];
    const size_t size = wire_format_read("segment", shown, sizeof shown);
    FILE *file = fopen(path, "w");
    CHECK(file != NULL && fwrite(shown, 1, size, file) == size && fclose(file) == 0);
    conduit_ring_info info;
    CHECK(conduit_ring_topic_info(topic, &info) == 0);
    CHECK(info.geometry.slot_count == 2 && info.geometry.slot_size_bytes == 64
        && info.published == 3);
    CHECK(info.state == CONDUIT_RING_STATE_DEAD && info.writer_pid == 12345);
    CHECK(info.instance_id == UINT64_C(0x0123456789abcdef)
        && info.last_publish_ns == UINT64_C(1234567890123456789));
    CHECK(info.content_tag == conduit_ring_content_tag("text/plain"));

    conduit_ring_subscriber *subscriber =
        subscriber_of(CONDUIT_RING_START_HISTORY, 16, CONDUIT_RING_POLICY_ALL);
    conduit_ring_message *message = message_of_nothing();
    expect_event(subscriber, message, CONDUIT_RING_EVENT_MESSAGE);
    expect_text(message, "message1");
    expect_event(subscriber, message, CONDUIT_RING_EVENT_MESSAGE);
    expect_text(message, "message2");
    CHECK(conduit_ring_message_meta(message).sequence == 2);
    CHECK(conduit_ring_message_meta(message).timestamp_ns == UINT64_C(1234567890123456789));
    conduit_ring_message_free(message);
    conduit_ring_subscriber_close(subscriber);
}

#define CASE(name) {#name, name}
static const struct {
    const char *name;
    void (*run)(void);
} CASES[] = {
    CASE(every_null_and_every_invalid_value_is_an_error_with_a_message),
    CASE(options_of_another_version_are_an_error),
    CASE(messages_of_one_part_and_of_many_arrive_whole),
    CASE(a_message_that_does_not_fit_is_rejected_and_counted),
    CASE(a_message_too_large_for_the_callers_buffer_is_kept),
    CASE(a_publishers_start_and_end_are_events),
    CASE(an_abandoned_topic_is_taken_over_at_the_same_number),
    CASE(history_latest_and_losses),
    CASE(waiting_ends_in_time_and_by_the_waker),
    CASE(a_subscriber_in_use_by_another_thread_is_an_error),
    CASE(a_topic_can_be_inspected_from_outside),
    CASE(messages_over_the_given_size_are_rejected_and_counted),
    CASE(the_clock_is_the_one_that_stamps_messages),
    CASE(a_lease_keeps_a_message_in_its_slot_until_it_is_released),
    CASE(a_fourth_lease_is_an_error_and_its_message_is_kept),
    CASE(a_lease_returns_events_and_starts_with_the_kept_message),
    CASE(a_loan_is_published_when_it_is_committed),
    CASE(an_ended_publisher_keeps_its_loan_and_fails_all_calls),
    CASE(a_publisher_without_a_thread_is_checked_by_its_owner),
    CASE(a_guarded_subscriber_survives_a_truncated_file),
    CASE(a_segment_is_written_and_read_as_in_the_wire_format),
};

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    topic = argv[2];
    for (size_t i = 0; i < sizeof CASES / sizeof *CASES; ++i) {
        if (strcmp(argv[1], CASES[i].name) == 0) {
            CASES[i].run();
            return 0;
        }
    }
    fprintf(stderr, "there is no case %s\n", argv[1]);
    return 2;
}
