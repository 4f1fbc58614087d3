/*
 * conduit_ring.h - message rings in shared memory: one publisher, many subscribers, any process.
 *
 * A topic is a file, /dev/shm/conduit_<topic>. Its one publisher overwrites the oldest message with the newest and never
 * waits for anybody; each subscriber copies messages out, and gets a message whole and as it was published, or learns
 * that it was lost. Either side may die at any moment, by SIGKILL too: the next publisher goes on with the topic, and
 * the others are told. Link with `pkg-config --cflags --libs conduit_ring`. Linux only.
 *
 * Errors. Functions that can fail return 0 or a negative errno; conduit_ring_last_error() has the sentence.
 *   -EINVAL           the caller's mistake: a NULL that must not be one, a wrong name, value or abi_version
 *   -EBUSY            opening: another publisher of this topic lives; publishing: subscribers hold all slots, counted,
 *                     nothing published
 *   -EPERM            the topic's file belongs to a user who is not trusted (CONDUIT_RING_TRUSTED_UIDS in the
 *                     environment lists those who are)
 *   -ESTALE           publishing: the topic's file was removed or replaced, and cannot be made anew; the sentence says why
 *                     (another publisher has the name). Nothing was published, and it is tried again
 *   -EEXIST           the topic's file was made by a publisher without the extension and may be in use
 *                     (CONDUIT_RING_FORCE replaces it)
 *   -EPROTO           the topic's file is not a ring, or of an unknown version
 *   -EUSERS           the topic has 16 subscribers already
 *   -ENOENT           there is no such topic
 *   -EMSGSIZE         the message does not fit into a slot: counted, nothing published
 *   -EMFILE           three leases of the subscriber are held already; the message is kept
 *   -EAGAIN, -ETIMEDOUT, -ECANCELED
 *                     nothing to read; not in time; the waker was used. These are no faults: the sentence is not set.
 *   -ENOBUFS          the buffer is too small for the message, which is kept for the next read
 *   -EALREADY         another thread is using this subscriber; a loan of this publisher is out
 *   -ESHUTDOWN        this publisher has ended its topic
 *   -EPERM            the handle belongs to the process that forked this one
 *   -ENOTRECOVERABLE  a fault inside the library, or a handle that had one before; close it
 *   any other         what the operating system answered
 *
 * Threads. A publisher may be used by several threads at once. A subscriber may be used by one at a time; only its
 * wakers may be used meanwhile. Close a handle when no thread uses it any more. A child after fork()
 * may close its parent's handles, which changes nothing for the parent; whatever else is asked of them answers -EPERM.
 *
 * A topic's file that is removed or replaced is made anew under the same numbers, within a second and while nothing is
 * published, too: each publisher has a thread that looks after its name, gets no signals and sleeps otherwise
 * (CONDUIT_RING_NO_THREAD: it has none). Not while a loan is out.
 *
 * Units stand in the names: _ns, _bytes. Times are of CLOCK_MONOTONIC_RAW.
 */
#ifndef CONDUIT_RING_H
#define CONDUIT_RING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Versions ------------------------------------------------------------------------------------------------- */

/* Changes with every change of this header that a compiled program would notice; also the soname's number. */
#define CONDUIT_RING_ABI_VERSION 2u

/* CONDUIT_RING_ABI_VERSION of the library that is really there. */
uint32_t conduit_ring_abi_version(void);

/* Version of the library, such as "0.1.0". */
const char *conduit_ring_version(void);

/*
 * The sentence of this thread's last error: which topic, what was given, what is accepted. Never NULL; "" before the
 * first error. Valid until the next error of the same thread, and not cleared by success.
 */
const char *conduit_ring_last_error(void);

/* ---- Clock ---------------------------------------------------------------------------------------------------- */

/* Now, on the clock that stamps messages (CLOCK_MONOTONIC_RAW). It never steps; all processes of a machine share it. */
uint64_t conduit_ring_clock_now_ns(void);

/* What to add to such a time to get wall time (ns since 1970), as of now. */
int64_t conduit_ring_clock_realtime_offset_ns(void);

/* ---- Geometry ------------------------------------------------------------------------------------------------- */

/* Number and length of a ring's slots. The longest message has slot_size_bytes - CONDUIT_RING_SLOT_HEADER_BYTES, whatever
 * the file rounds a slot's length up to (a multiple of 64). */
typedef struct conduit_ring_geometry {
    uint32_t slot_count;      /* a power of two, up to 2^20 */
    uint32_t slot_size_bytes; /* with the slot's header; up to 2^30 */
} conduit_ring_geometry;

#define CONDUIT_RING_SLOT_HEADER_BYTES 20u

/* As conduit counts: a slot's length includes its header. -EINVAL outside the limits. */
int conduit_ring_geometry_slots(uint32_t slot_count, uint32_t slot_size_bytes, conduit_ring_geometry *geometry);

/* As a user thinks: at least `depth` messages, rounded up to a power of two, of up to `max_message_size_bytes`. */
int conduit_ring_geometry_depth(uint32_t depth, uint32_t max_message_size_bytes, conduit_ring_geometry *geometry);

/* ---- Publishing ----------------------------------------------------------------------------------------------- */

typedef struct conduit_ring_publisher conduit_ring_publisher;

/* `flags`: replace a topic's file that is not ours although a process may still use it. */
#define CONDUIT_RING_FORCE 1u
/* `flags`: no thread looks after the topic's name; conduit_ring_publisher_look_after() does. */
#define CONDUIT_RING_NO_THREAD 2u
/* `group`: the process's own. */
#define CONDUIT_RING_OWN_GROUP 0xFFFFFFFFu

/* Begin with CONDUIT_RING_PUBLISHER_OPTIONS_INIT and change what you need. */
typedef struct conduit_ring_publisher_options {
    uint32_t abi_version; /* CONDUIT_RING_ABI_VERSION */
    uint32_t flags;       /* CONDUIT_RING_FORCE and CONDUIT_RING_NO_THREAD, or 0 */
    conduit_ring_geometry geometry;
    const char *content;  /* name of the messages' encoding, "sensor_msgs/msg/Imu"; NULL for raw bytes */
    uint32_t mode;        /* permissions of the topic's file, whatever the umask */
    uint32_t group;       /* group of the file, or CONDUIT_RING_OWN_GROUP */
} conduit_ring_publisher_options;

#define CONDUIT_RING_PUBLISHER_OPTIONS_INIT \
    { CONDUIT_RING_ABI_VERSION, 0u, { 16u, 4096u }, NULL, 0660u, CONDUIT_RING_OWN_GROUP }

/* One part of a message. Laid out as struct iovec. */
typedef struct conduit_ring_part {
    const void *data; /* may be NULL if size_bytes is 0 */
    size_t size_bytes;
} conduit_ring_part;

/*
 * Makes the topic; or goes on with it where a publisher that died left it, at the same sequence number and unnoticed by
 * its subscribers, if geometry and content are the same, and replaces it otherwise. `options` may be NULL: 16 slots of
 * 4096 bytes, raw. *publisher is NULL after an error. -EBUSY while another publisher lives.
 */
int conduit_ring_publisher_open(const char *topic, const conduit_ring_publisher_options *options,
                                conduit_ring_publisher **publisher);

/*
 * Publishes a message. Waits for no subscriber, and makes no system call unless one sleeps. `sequence`, which may be
 * NULL, gets its number; they count from 0. -EMSGSIZE when it does not fit,
 * -EBUSY when subscribers hold all slots: then the message is dropped, and the next one gets its number. A slot that is
 * held among others is passed over, and its number with it: other subscribers count that as lost.
 */
int conduit_ring_publisher_publish(conduit_ring_publisher *publisher, const void *data, size_t size_bytes,
                                   uint64_t *sequence);

/* Publishes the parts as one message, each copied straight into the slot. */
int conduit_ring_publisher_publish_parts(conduit_ring_publisher *publisher, const conduit_ring_part *parts,
                                         size_t part_count, uint64_t *sequence);

/*
 * Lends the next slot, for a message of up to `size_bytes` bytes that is written to *data piece by piece, without a copy
 * of it elsewhere. Nothing is published before conduit_ring_publisher_commit(). *data may be written, and is of any
 * alignment, until the loan is committed or cancelled or the publisher closed; it has the bytes of older messages. The
 * oldest message of the ring is lost from here on. Errors as of publishing; *data is NULL then. One loan at a time, and
 * nothing else is published meanwhile: -EALREADY.
 */
int conduit_ring_publisher_loan(conduit_ring_publisher *publisher, size_t size_bytes, void **data);

/* Publishes the first `size_bytes` bytes of the loan. -EINVAL when it has fewer (and is still out), or there is none. */
int conduit_ring_publisher_commit(conduit_ring_publisher *publisher, size_t size_bytes, uint64_t *sequence);

/*
 * Looks now whether the topic's name leads to this publisher's file, and makes that anew if not. Publishing looks by itself,
 * and so does the publisher's thread; this is for who wants no thread (CONDUIT_RING_NO_THREAD) and has a loop of its own,
 * to call a few times a second. -ESTALE: as of publishing. -EALREADY while a loan is out.
 */
int conduit_ring_publisher_look_after(conduit_ring_publisher *publisher);

/* Ends the loan, if there is one. Nothing was published, and the next message takes the same slot and number. */
int conduit_ring_publisher_cancel(conduit_ring_publisher *publisher);

/*
 * Ends the topic: subscribers read what is left and then learn that the publisher is gone. The handle stays, as does the
 * memory of a loan that is out, until the handle is closed; whatever else is asked of it answers -ESHUTDOWN.
 */
int conduit_ring_publisher_end(conduit_ring_publisher *publisher);

/* Ends the topic and frees the handle. A loan that is out must not be used any more. NULL is fine. */
int conduit_ring_publisher_close(conduit_ring_publisher *publisher);

/* Lets go of the topic as a death would: it stays, and the next publisher goes on with it. NULL is fine. */
int conduit_ring_publisher_abandon(conduit_ring_publisher *publisher);

/* ---- Subscribing ---------------------------------------------------------------------------------------------- */

typedef struct conduit_ring_subscriber conduit_ring_subscriber;

/* Which messages to begin with. A topic that does not exist yet is read from its first message. */
#define CONDUIT_RING_START_NEW 0u     /* those published from now on */
#define CONDUIT_RING_START_LATEST 1u  /* the newest one that is there, then new ones */
#define CONDUIT_RING_START_HISTORY 2u /* the last `history` that are still there, then new ones */

/* Which messages to get after falling behind. */
#define CONDUIT_RING_POLICY_ALL 0u    /* every one that is still there, in order */
#define CONDUIT_RING_POLICY_LATEST 1u /* only the newest; those skipped count as lost */

/*
 * Whether to read without touching memory that another process could take away: who may write a topic's file may shorten
 * it, and that is a SIGBUS for all who have it mapped. Guarded, it is -EPROTO. Costs a few system calls for each message;
 * leases are copies, and the subscriber does not show among the topic's readers.
 */
#define CONDUIT_RING_GUARD_AUTO 0u   /* when the file belongs to another user than this process's */
#define CONDUIT_RING_GUARD_ALWAYS 1u
#define CONDUIT_RING_GUARD_NEVER 2u  /* all who may write the file are trusted */

/* Begin with CONDUIT_RING_SUBSCRIBER_OPTIONS_INIT and change what you need. */
typedef struct conduit_ring_subscriber_options {
    uint32_t abi_version; /* CONDUIT_RING_ABI_VERSION */
    uint32_t start;       /* CONDUIT_RING_START_... */
    uint32_t history;     /* with CONDUIT_RING_START_HISTORY: how many */
    uint32_t policy;      /* CONDUIT_RING_POLICY_... */
    uint32_t guard;       /* CONDUIT_RING_GUARD_... */
} conduit_ring_subscriber_options;

#define CONDUIT_RING_SUBSCRIBER_OPTIONS_INIT \
    { CONDUIT_RING_ABI_VERSION, CONDUIT_RING_START_NEW, 0u, CONDUIT_RING_POLICY_ALL, CONDUIT_RING_GUARD_AUTO }

/* What a read gave. */
#define CONDUIT_RING_EVENT_MESSAGE 1u        /* a message */
#define CONDUIT_RING_EVENT_PUBLISHER_UP 2u   /* the topic has a publisher again, or for the first time */
#define CONDUIT_RING_EVENT_PUBLISHER_DOWN 3u /* it died, closed the topic or was replaced; what it had published came before */

/* `timeout_ns`: no end. */
#define CONDUIT_RING_FOREVER UINT64_MAX

/* What a message says about itself. */
typedef struct conduit_ring_meta {
    uint64_t sequence;     /* its number */
    uint64_t timestamp_ns; /* when it was published */
    uint64_t lost;         /* messages lost between the one delivered before it and this one */
    size_t size_bytes;
} conduit_ring_meta;

/* What a subscriber has seen in its whole life. */
typedef struct conduit_ring_stats {
    uint64_t delivered;
    uint64_t lost;
    uint64_t resyncs; /* times that the publisher's count was found behind the reader's */
} conduit_ring_stats;

/* A buffer that grows to the messages read into it. Read into the same one again and again. */
typedef struct conduit_ring_message conduit_ring_message;

int conduit_ring_message_new(conduit_ring_message **message);
void conduit_ring_message_free(conduit_ring_message *message);

/* The bytes, private to this process, until the next read into `message`. Not NULL unless `message` is. */
const void *conduit_ring_message_data(const conduit_ring_message *message);

/* Zeros if the last read into it gave no message. */
conduit_ring_meta conduit_ring_message_meta(const conduit_ring_message *message);

/*
 * Subscribes to a topic, which need not exist yet. `options` may be NULL: new messages, all of them. The subscriber
 * outlives publishers: it says when one goes or comes, and goes on by itself. *subscriber is NULL after an error.
 */
int conduit_ring_subscriber_open(const char *topic, const conduit_ring_subscriber_options *options,
                                 conduit_ring_subscriber **subscriber);

/* Takes what comes next, without waiting. 0: *event says what. -EAGAIN: nothing new. */
int conduit_ring_subscriber_try_read(conduit_ring_subscriber *subscriber, conduit_ring_message *message,
                                     uint32_t *event);

/* The same, into `capacity_bytes` bytes of the caller's. -ENOBUFS: *meta says how many are needed; nothing is lost. */
int conduit_ring_subscriber_try_read_into(conduit_ring_subscriber *subscriber, void *buffer, size_t capacity_bytes,
                                          conduit_ring_meta *meta, uint32_t *event);

/* Takes what comes next, and waits for it. -ETIMEDOUT, -ECANCELED. */
int conduit_ring_subscriber_read(conduit_ring_subscriber *subscriber, conduit_ring_message *message,
                                 uint64_t timeout_ns, uint32_t *event);

/*
 * A message that stays where it lies, in its slot of the ring, until the lease is released: for large ones. The publisher
 * leaves the slot alone meanwhile. It does not wait: when it has gone round the ring and comes to this slot, it drops its
 * new messages. So release it within slot_count - 1 periods of the topic. Dead holders hold nothing.
 */
typedef struct conduit_ring_lease conduit_ring_lease;

/*
 * Takes what comes next without copying it, and waits for it; a `timeout_ns` of 0 only looks. *lease is NULL unless
 * *event is CONDUIT_RING_EVENT_MESSAGE. At most three leases of a subscriber are held at once: -EMFILE. -ETIMEDOUT,
 * -ECANCELED.
 *
 * A lease may outlive its subscriber and may be used and released by any thread. Where no publisher would respect a hold
 * (a legacy one, a guarded topic, a message that is about to be overwritten) it is a copy and does not count.
 */
int conduit_ring_subscriber_lease(conduit_ring_subscriber *subscriber, uint64_t timeout_ns, conduit_ring_lease **lease,
                                  uint32_t *event);

/* The bytes, of any alignment, for reading only, until the lease is released. NULL only if `lease` is. */
const void *conduit_ring_lease_data(const conduit_ring_lease *lease);
conduit_ring_meta conduit_ring_lease_meta(const conduit_ring_lease *lease);

/* Whether the publisher leaves a slot alone for it; if not, it is a copy. */
bool conduit_ring_lease_holds_slot(const conduit_ring_lease *lease);

/* NULL is fine. */
void conduit_ring_lease_release(conduit_ring_lease *lease);

/* Sleeps until there is something to read. -ETIMEDOUT, -ECANCELED. */
int conduit_ring_subscriber_wait(conduit_ring_subscriber *subscriber, uint64_t timeout_ns);

/* Sleeps until the topic exists, whether or not anything was published yet. -ETIMEDOUT, -ECANCELED. */
int conduit_ring_subscriber_await_topic(conduit_ring_subscriber *subscriber, uint64_t timeout_ns);

int conduit_ring_subscriber_set_policy(conduit_ring_subscriber *subscriber, uint32_t policy);

/* Whether the topic had a live publisher when last looked at. */
int conduit_ring_subscriber_publisher_up(conduit_ring_subscriber *subscriber, bool *up);

/* Of the topic as it is now. -ENOENT while there is none. */
int conduit_ring_subscriber_geometry(conduit_ring_subscriber *subscriber, conduit_ring_geometry *geometry);
int conduit_ring_subscriber_content_tag(conduit_ring_subscriber *subscriber, uint64_t *content_tag);

int conduit_ring_subscriber_stats(conduit_ring_subscriber *subscriber, conduit_ring_stats *stats);

/* Frees the reader slot and the subscriber. Its wakers stay valid. NULL is fine. */
int conduit_ring_subscriber_close(conduit_ring_subscriber *subscriber);

/*
 * A handle with which other threads end the subscriber's current wait or read, or its next one, with -ECANCELED. Any
 * number of wake-ups before it looks are one.
 */
typedef struct conduit_ring_waker conduit_ring_waker;

int conduit_ring_subscriber_waker(conduit_ring_subscriber *subscriber, conduit_ring_waker **waker);
int conduit_ring_waker_wake(const conduit_ring_waker *waker);
void conduit_ring_waker_free(conduit_ring_waker *waker);

/* ---- Looking at a topic --------------------------------------------------------------------------------------- */

#define CONDUIT_RING_STATE_UNKNOWN 0u /* it says something that it should not */
#define CONDUIT_RING_STATE_LIVE 1u    /* its publisher lives */
#define CONDUIT_RING_STATE_CLOSED 2u  /* its publisher closed it */
#define CONDUIT_RING_STATE_RETIRED 3u /* it was replaced by one of another geometry */
#define CONDUIT_RING_STATE_DEAD 4u    /* its publisher died; the next one takes over */
#define CONDUIT_RING_STATE_LEGACY 5u  /* made by a publisher without the extension, of whose life nothing is known */

#define CONDUIT_RING_READERS 16u

/* A claimed reader slot. */
typedef struct conduit_ring_reader {
    uint32_t index;  /* number of the slot */
    uint32_t pid;
    bool is_native;  /* speaks the extension; if not, only index and next_sequence mean something */
    bool is_alive;   /* a native reader that is not leaked its slot */
    bool is_waiting; /* sleeps */
    uint64_t next_sequence;
    uint64_t lost;
} conduit_ring_reader;

/* What there is to know about a topic, at one moment. */
typedef struct conduit_ring_info {
    conduit_ring_geometry geometry;
    uint32_t max_message_size_bytes;
    uint32_t state;             /* CONDUIT_RING_STATE_... */
    uint32_t epoch;             /* takeovers so far */
    uint32_t writer_pid;
    uint64_t published;         /* messages so far, which is the next sequence number */
    uint64_t content_tag;       /* conduit_ring_content_tag() of the encoding's name, 0 for raw bytes */
    uint64_t instance_id;       /* random number of this very file; 0 if it has no extension */
    uint64_t last_publish_ns;   /* 0 before the first message */
    int64_t realtime_offset_ns; /* what to add to a time stamp to get wall time, as of the publisher's start */
    uint64_t dropped_pinned;    /* numbers passed over, and messages dropped, since readers held slots */
    uint64_t rejected_oversize;
    uint64_t wake_count;        /* times that sleepers were called */
    uint32_t reader_count;      /* how many of `readers` are filled */
    conduit_ring_reader readers[CONDUIT_RING_READERS];
} conduit_ring_info;

/* From outside: nothing is written and no reader slot taken. -ENOENT, -EPROTO. */
int conduit_ring_topic_info(const char *topic, conduit_ring_info *info);

/* The same of one's own topic. */
int conduit_ring_publisher_info(conduit_ring_publisher *publisher, conduit_ring_info *info);

/* The tag of an encoding's name: FNV-1a, 64 bits. 0 for NULL and for what is not UTF-8. */
uint64_t conduit_ring_content_tag(const char *content);

#ifdef __cplusplus
}
#endif

#endif
