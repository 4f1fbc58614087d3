/**
 * @file conduit_ring.h
 * @brief Message rings in shared memory for Linux: one publisher, many subscribers.
 *
 * A topic is a file, /dev/shm/conduit_<topic>. Its single publisher overwrites the oldest message
 * with the newest and never waits for a subscriber. Each subscriber copies messages out: it gets
 * a message complete and as it was published, or learns that the message was lost. Both sides may
 * die at any time, even by SIGKILL: the next publisher takes the topic over, and the subscribers
 * are notified. Link with `pkg-config --cflags --libs conduit_ring`.
 *
 * @code
 * conduit_ring_publisher *publisher;
 * if (conduit_ring_publisher_open("chatter", NULL, &publisher) != 0) {
 *     fprintf(stderr, "%s\n", conduit_ring_last_error());
 *     return 1;
 * }
 * conduit_ring_publisher_publish(publisher, "hello", 5, NULL);
 * conduit_ring_publisher_close(publisher);
 * @endcode
 *
 * **Errors.** A function that can fail returns 0 or a negative errno. conduit_ring_last_error()
 * returns the message.
 *
 * - -EINVAL: a mistake of the caller: NULL where it is not allowed, an invalid name or value, a
 *   wrong abi_version
 * - -EBUSY: opening: the topic has a live publisher; publishing: subscribers hold all slots, the
 *   message is dropped and counted
 * - -EPERM: the topic's file belongs to an untrusted user (CONDUIT_RING_TRUSTED_UIDS in the
 *   environment lists trusted ones), or the handle belongs to the parent of a forked process
 * - -ESTALE: publishing: the topic's file was removed or replaced and cannot be created again;
 *   the message says why. Nothing was published; the next call tries again
 * - -EEXIST: the topic's file is from a publisher without the extension and may be in use
 *   (CONDUIT_RING_FORCE replaces it)
 * - -EPROTO: the topic's file is not a ring or has an unknown version
 * - -EUSERS: the topic has 16 subscribers already
 * - -ENOENT: the topic does not exist
 * - -EMSGSIZE: the message does not fit into a slot; it is dropped and counted
 * - -EMFILE: the subscriber holds three leases already; the message stays in the ring
 * - -EAGAIN, -ETIMEDOUT, -ECANCELED: no message, timeout, or woken by a waker. These are not
 *   failures and set no message
 * - -ENOBUFS: the message does not fit into the buffer; it is kept for the next read
 * - -EALREADY: another thread uses this subscriber, or a loan of this publisher is outstanding
 * - -ESHUTDOWN: this publisher has ended its topic
 * - -ENOTRECOVERABLE: a fault inside the library, now or in an earlier call on this handle; close
 *   the handle
 * - other: an error of the operating system
 *
 * **Threads.** Several threads may use a publisher at once. Only one thread at a time may use a
 * subscriber; other threads may use its wakers meanwhile. Close a handle when no thread uses it.
 * After fork(), a child may close its parent's handles without effect on the parent; every other
 * function returns -EPERM for them.
 *
 * **Names of topics.** If a topic's file is removed or replaced, its publisher creates it again
 * within a second, with continuous sequence numbers, even while nothing is published. Each
 * publisher has a thread for this, which blocks all signals and sleeps otherwise
 * (CONDUIT_RING_NO_THREAD disables it). It does nothing while a loan is outstanding.
 *
 * **Units** are part of the names: _ns, _bytes. Times are of CLOCK_MONOTONIC_RAW.
 */
#ifndef CONDUIT_RING_H
#define CONDUIT_RING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Versions ------------------------------------------------------------------------------ */

/**
 * @brief The version of the ABI: changes with each change of this header that affects compiled
 * programs. It is the number of the soname too.
 */
#define CONDUIT_RING_ABI_VERSION 2u

/** @brief Returns the CONDUIT_RING_ABI_VERSION of the loaded library. */
uint32_t conduit_ring_abi_version(void);

/** @brief Returns the version of the library, such as "0.1.0". */
const char *conduit_ring_version(void);

/**
 * @brief Returns the message of this thread's last error: the topic, what was expected and what
 * was given.
 *
 * Never returns NULL; returns "" before the first error. The text is valid until the next error
 * of the same thread. Success does not clear it.
 */
const char *conduit_ring_last_error(void);

/* ---- Clock --------------------------------------------------------------------------------- */

/**
 * @brief Returns the time of the clock that stamps messages, CLOCK_MONOTONIC_RAW. It never steps
 * and is the same for all processes of a machine.
 */
uint64_t conduit_ring_clock_now_ns(void);

/**
 * @brief Returns the current difference from that clock to wall time (ns since 1970). Add it to a
 * timestamp.
 */
int64_t conduit_ring_clock_realtime_offset_ns(void);

/* ---- Geometry ------------------------------------------------------------------------------ */

/**
 * @brief Number and size of a ring's slots.
 *
 * The longest message has slot_size_bytes - CONDUIT_RING_SLOT_HEADER_BYTES bytes. The file rounds
 * the slot size up to a multiple of 64, which does not change that limit.
 */
typedef struct conduit_ring_geometry {
    uint32_t slot_count;      /**< A power of two, up to 2^20. */
    uint32_t slot_size_bytes; /**< Includes the slot's header; up to 2^30. */
} conduit_ring_geometry;

/** @brief The size of a slot's header. */
#define CONDUIT_RING_SLOT_HEADER_BYTES 20u

/**
 * @brief Sets a geometry from conduit's numbers: the slot size includes the header.
 * @return 0, or -EINVAL outside the limits.
 */
int conduit_ring_geometry_slots(uint32_t slot_count, uint32_t slot_size_bytes,
                                conduit_ring_geometry *geometry);

/**
 * @brief Sets a geometry from a user's numbers: at least `depth` messages, rounded up to a power
 * of two, of up to `max_message_size_bytes` bytes.
 * @return 0, or -EINVAL outside the limits.
 */
int conduit_ring_geometry_depth(uint32_t depth, uint32_t max_message_size_bytes,
                                conduit_ring_geometry *geometry);

/* ---- Publishing ---------------------------------------------------------------------------- */

/** @brief The publisher of a topic. */
typedef struct conduit_ring_publisher conduit_ring_publisher;

/** @brief `flags`: replace a topic's foreign file even if a process may still use it. */
#define CONDUIT_RING_FORCE 1u
/**
 * @brief `flags`: start no thread that checks the topic's name. Call
 * conduit_ring_publisher_look_after() instead.
 */
#define CONDUIT_RING_NO_THREAD 2u
/** @brief `group`: the group of the process. */
#define CONDUIT_RING_OWN_GROUP 0xFFFFFFFFu

/**
 * @brief The options of a publisher. Start with CONDUIT_RING_PUBLISHER_OPTIONS_INIT and change
 * fields as needed.
 */
typedef struct conduit_ring_publisher_options {
    uint32_t abi_version; /**< CONDUIT_RING_ABI_VERSION. */
    uint32_t flags;       /**< CONDUIT_RING_FORCE, CONDUIT_RING_NO_THREAD, both or 0. */
    conduit_ring_geometry geometry;
    const char *content;  /**< The encoding, such as "sensor_msgs/msg/Imu"; NULL for raw bytes. */
    uint32_t mode;        /**< Permissions of the topic's file, independent of the umask. */
    uint32_t group;       /**< Group of the file, or CONDUIT_RING_OWN_GROUP. */
} conduit_ring_publisher_options;

/** @brief The default options: 16 slots of 4096 bytes, raw, mode 0660. */
#define CONDUIT_RING_PUBLISHER_OPTIONS_INIT \
    { CONDUIT_RING_ABI_VERSION, 0u, { 16u, 4096u }, NULL, 0660u, CONDUIT_RING_OWN_GROUP }

/** @brief One part of a message, with the layout of struct iovec. */
typedef struct conduit_ring_part {
    const void *data; /**< May be NULL if size_bytes is 0. */
    size_t size_bytes;
} conduit_ring_part;

/**
 * @brief Opens the publisher of a topic.
 *
 * Creates the topic, or takes it over from a publisher that died: with the same geometry and
 * content it continues at the same sequence number, unnoticed by subscribers; otherwise it
 * replaces the topic.
 *
 * @param topic 1 to 200 characters of A-Z a-z 0-9 _ . -
 * @param options NULL for CONDUIT_RING_PUBLISHER_OPTIONS_INIT.
 * @param[out] publisher The handle; NULL after an error.
 * @return 0, -EBUSY while another publisher is alive, or another error.
 */
int conduit_ring_publisher_open(const char *topic, const conduit_ring_publisher_options *options,
                                conduit_ring_publisher **publisher);

/**
 * @brief Publishes a message.
 *
 * Never waits for a subscriber, and makes no system call unless a subscriber sleeps.
 *
 * @param data The message; may be NULL if `size_bytes` is 0.
 * @param size_bytes The size of the message.
 * @param[out] sequence The message's sequence number, from 0; may be NULL.
 * @return 0; -EMSGSIZE when the message does not fit into a slot; -EBUSY when subscribers hold
 * all slots. In both cases the message is dropped and the next one gets its number. If
 * subscribers hold only the next slots, the publisher skips these with their numbers, which other
 * subscribers count as lost.
 */
int conduit_ring_publisher_publish(conduit_ring_publisher *publisher, const void *data,
                                   size_t size_bytes, uint64_t *sequence);

/**
 * @brief Publishes parts as one message. Each part is copied directly into the slot.
 *
 * Otherwise as conduit_ring_publisher_publish().
 */
int conduit_ring_publisher_publish_parts(conduit_ring_publisher *publisher,
                                         const conduit_ring_part *parts, size_t part_count,
                                         uint64_t *sequence);

/**
 * @brief Lends the next slot, so that a message can be written in place without another copy.
 *
 * conduit_ring_publisher_commit() publishes the message. Until then nothing is published. The
 * memory may be written until the loan is committed or cancelled or the publisher closed. It has
 * no particular alignment and contains bytes of older messages. The ring's oldest message is lost
 * from this call on.
 *
 * @param size_bytes The largest size of the message.
 * @param[out] data The memory to write to; NULL after an error.
 * @return 0, -EALREADY while a loan is outstanding, or an error of publishing. During a loan,
 * publishing fails with -EALREADY too.
 */
int conduit_ring_publisher_loan(conduit_ring_publisher *publisher, size_t size_bytes,
                                void **data);

/**
 * @brief Publishes the first `size_bytes` bytes of the loan.
 * @return 0; -EINVAL without a loan, or when the loan is smaller, in which case it stays
 * outstanding.
 */
int conduit_ring_publisher_commit(conduit_ring_publisher *publisher, size_t size_bytes,
                                  uint64_t *sequence);

/**
 * @brief Checks whether the topic's name still refers to this publisher's file, and creates the
 * file again if not.
 *
 * Publishing checks it too, and so does the publisher's thread. This function is for programs
 * with CONDUIT_RING_NO_THREAD and a loop of their own; call it a few times per second.
 *
 * @return 0, -ESTALE as publishing does, or -EALREADY while a loan is outstanding.
 */
int conduit_ring_publisher_look_after(conduit_ring_publisher *publisher);

/**
 * @brief Cancels the loan, if there is one. Nothing is published; the next message gets the same
 * slot and number.
 */
int conduit_ring_publisher_cancel(conduit_ring_publisher *publisher);

/**
 * @brief Ends the topic: subscribers read the remaining messages and are then notified.
 *
 * The handle and the memory of an outstanding loan stay valid until the handle is closed. Every
 * other function returns -ESHUTDOWN for the handle.
 */
int conduit_ring_publisher_end(conduit_ring_publisher *publisher);

/**
 * @brief Ends the topic and frees the handle. Invalidates an outstanding loan. Accepts NULL.
 */
int conduit_ring_publisher_close(conduit_ring_publisher *publisher);

/**
 * @brief Frees the handle and leaves the topic as a crash would, so that the next publisher takes
 * it over. Accepts NULL.
 */
int conduit_ring_publisher_abandon(conduit_ring_publisher *publisher);

/* ---- Subscribing --------------------------------------------------------------------------- */

/** @brief A subscriber of a topic. */
typedef struct conduit_ring_subscriber conduit_ring_subscriber;

/** @brief `start`: messages published from now on. A topic that does not exist yet is always read
 * from its first message. */
#define CONDUIT_RING_START_NEW 0u
/** @brief `start`: the newest message in the ring, then new ones. */
#define CONDUIT_RING_START_LATEST 1u
/** @brief `start`: the last `history` messages that are still in the ring, then new ones. */
#define CONDUIT_RING_START_HISTORY 2u

/** @brief `policy`: after falling behind, all messages that are still in the ring, in order. */
#define CONDUIT_RING_POLICY_ALL 0u
/** @brief `policy`: after falling behind, only the newest message; skipped ones count as lost. */
#define CONDUIT_RING_POLICY_LATEST 1u

/**
 * @brief `guard`: read guarded if the file belongs to another user.
 *
 * A user who may write a topic's file may also truncate it, which kills all processes that have
 * it mapped (SIGBUS). A guarded subscriber does not map the file and gets -EPROTO instead. It
 * needs a few system calls for each message, its leases are copies, and it does not appear among
 * the topic's readers.
 */
#define CONDUIT_RING_GUARD_AUTO 0u
/** @brief `guard`: always read guarded. */
#define CONDUIT_RING_GUARD_ALWAYS 1u
/** @brief `guard`: never read guarded; trust all users who may write the file. */
#define CONDUIT_RING_GUARD_NEVER 2u

/**
 * @brief The options of a subscriber. Start with CONDUIT_RING_SUBSCRIBER_OPTIONS_INIT and change
 * fields as needed.
 */
typedef struct conduit_ring_subscriber_options {
    uint32_t abi_version; /**< CONDUIT_RING_ABI_VERSION. */
    uint32_t start;       /**< CONDUIT_RING_START_... */
    uint32_t history;     /**< Number of messages for CONDUIT_RING_START_HISTORY. */
    uint32_t policy;      /**< CONDUIT_RING_POLICY_... */
    uint32_t guard;       /**< CONDUIT_RING_GUARD_... */
} conduit_ring_subscriber_options;

/** @brief The default options: all new messages. */
#define CONDUIT_RING_SUBSCRIBER_OPTIONS_INIT \
    { CONDUIT_RING_ABI_VERSION, CONDUIT_RING_START_NEW, 0u, CONDUIT_RING_POLICY_ALL, \
      CONDUIT_RING_GUARD_AUTO }

/** @brief `event`: a message. */
#define CONDUIT_RING_EVENT_MESSAGE 1u
/** @brief `event`: the topic has a publisher, for the first time or again. */
#define CONDUIT_RING_EVENT_PUBLISHER_UP 2u
/** @brief `event`: the publisher died, closed the topic or was replaced. Its messages came before
 * this event. */
#define CONDUIT_RING_EVENT_PUBLISHER_DOWN 3u

/** @brief `timeout_ns`: no timeout. */
#define CONDUIT_RING_FOREVER UINT64_MAX

/** @brief The metadata of a message. */
typedef struct conduit_ring_meta {
    uint64_t sequence;     /**< The sequence number. */
    uint64_t timestamp_ns; /**< The time of publication. */
    uint64_t lost;         /**< Messages lost between the previous delivered one and this one. */
    size_t size_bytes;
} conduit_ring_meta;

/** @brief The counters of a subscriber since it was opened. */
typedef struct conduit_ring_stats {
    uint64_t delivered;
    uint64_t lost;
    uint64_t resyncs; /**< How often the publisher's count was behind the reader's. */
} conduit_ring_stats;

/** @brief A buffer that grows to the size of the messages read into it. Reuse it. */
typedef struct conduit_ring_message conduit_ring_message;

/** @brief Allocates a buffer. */
int conduit_ring_message_new(conduit_ring_message **message);

/** @brief Frees a buffer. Accepts NULL. */
void conduit_ring_message_free(conduit_ring_message *message);

/**
 * @brief Returns the message's bytes, which are private to this process and valid until the next
 * read into `message`. Returns NULL only if `message` is NULL.
 */
const void *conduit_ring_message_data(const conduit_ring_message *message);

/** @brief Returns the message's metadata, or zeros if the last read returned no message. */
conduit_ring_meta conduit_ring_message_meta(const conduit_ring_message *message);

/**
 * @brief Opens a subscriber of a topic, which need not exist yet.
 *
 * The subscriber outlives publishers: it reports when one stops or starts, and continues with the
 * next one.
 *
 * @param options NULL for CONDUIT_RING_SUBSCRIBER_OPTIONS_INIT.
 * @param[out] subscriber The handle; NULL after an error.
 * @return 0 or an error.
 */
int conduit_ring_subscriber_open(const char *topic,
                                 const conduit_ring_subscriber_options *options,
                                 conduit_ring_subscriber **subscriber);

/**
 * @brief Reads the next event without waiting.
 * @param[out] message The message, if the event is one.
 * @param[out] event CONDUIT_RING_EVENT_...
 * @return 0, or -EAGAIN without an event.
 */
int conduit_ring_subscriber_try_read(conduit_ring_subscriber *subscriber,
                                     conduit_ring_message *message, uint32_t *event);

/**
 * @brief Reads the next event without waiting, into a buffer of the caller's.
 * @return 0; -EAGAIN without an event; -ENOBUFS when the buffer is too small, in which case
 * meta->size_bytes is the size that is needed and the message is kept for the next read.
 */
int conduit_ring_subscriber_try_read_into(conduit_ring_subscriber *subscriber, void *buffer,
                                          size_t capacity_bytes, conduit_ring_meta *meta,
                                          uint32_t *event);

/**
 * @brief Waits for the next event and reads it.
 * @return 0, -ETIMEDOUT or -ECANCELED.
 */
int conduit_ring_subscriber_read(conduit_ring_subscriber *subscriber,
                                 conduit_ring_message *message, uint64_t timeout_ns,
                                 uint32_t *event);

/**
 * @brief A message that is read in its slot of the ring, without a copy, until the lease is
 * released. For large messages.
 *
 * The publisher skips the slot meanwhile; it does not wait. If leases hold all slots, it drops
 * its new messages. So release a lease within slot_count - 1 periods of the topic. The leases of
 * a process that dies end with it.
 */
typedef struct conduit_ring_lease conduit_ring_lease;

/**
 * @brief Waits for the next event and, if it is a message, leases it.
 *
 * A lease may outlive its subscriber, and any thread may use and release it. If the publisher
 * would not respect a lease (a legacy publisher, a guarded topic, a message that is about to be
 * overwritten), the lease is a copy and does not count.
 *
 * @param timeout_ns 0 returns at once.
 * @param[out] lease NULL unless *event is CONDUIT_RING_EVENT_MESSAGE.
 * @return 0, -EMFILE when the subscriber holds three leases, -ETIMEDOUT or -ECANCELED.
 */
int conduit_ring_subscriber_lease(conduit_ring_subscriber *subscriber, uint64_t timeout_ns,
                                  conduit_ring_lease **lease, uint32_t *event);

/**
 * @brief Returns the message's bytes, read-only and without a particular alignment, valid until
 * the lease is released. Returns NULL only if `lease` is NULL.
 */
const void *conduit_ring_lease_data(const conduit_ring_lease *lease);

/** @brief Returns the message's metadata. */
conduit_ring_meta conduit_ring_lease_meta(const conduit_ring_lease *lease);

/** @brief Returns whether the lease holds a slot of the ring. If not, it is a copy. */
bool conduit_ring_lease_holds_slot(const conduit_ring_lease *lease);

/** @brief Releases a lease. Accepts NULL. */
void conduit_ring_lease_release(conduit_ring_lease *lease);

/**
 * @brief Waits until an event can be read.
 * @return 0, -ETIMEDOUT or -ECANCELED.
 */
int conduit_ring_subscriber_wait(conduit_ring_subscriber *subscriber, uint64_t timeout_ns);

/**
 * @brief Waits until the topic exists, with or without messages.
 * @return 0, -ETIMEDOUT or -ECANCELED.
 */
int conduit_ring_subscriber_await_topic(conduit_ring_subscriber *subscriber, uint64_t timeout_ns);

/** @brief Changes the policy. */
int conduit_ring_subscriber_set_policy(conduit_ring_subscriber *subscriber, uint32_t policy);

/** @brief Sets `up` to whether the topic had a live publisher at the last read or wait. */
int conduit_ring_subscriber_publisher_up(conduit_ring_subscriber *subscriber, bool *up);

/**
 * @brief Sets `geometry` to that of the current topic.
 * @return 0, or -ENOENT without a topic.
 */
int conduit_ring_subscriber_geometry(conduit_ring_subscriber *subscriber,
                                     conduit_ring_geometry *geometry);

/**
 * @brief Sets `content_tag` to that of the current topic.
 * @return 0, or -ENOENT without a topic.
 */
int conduit_ring_subscriber_content_tag(conduit_ring_subscriber *subscriber,
                                        uint64_t *content_tag);

/** @brief Sets `stats` to the subscriber's counters. */
int conduit_ring_subscriber_stats(conduit_ring_subscriber *subscriber, conduit_ring_stats *stats);

/**
 * @brief Frees the reader slot and the subscriber. Its wakers and leases stay valid. Accepts
 * NULL.
 */
int conduit_ring_subscriber_close(conduit_ring_subscriber *subscriber);

/**
 * @brief A handle with which other threads end the subscriber's current wait or read, or the next
 * one, with -ECANCELED. Several wake-ups before that count as one.
 */
typedef struct conduit_ring_waker conduit_ring_waker;

/** @brief Creates a waker. */
int conduit_ring_subscriber_waker(conduit_ring_subscriber *subscriber,
                                  conduit_ring_waker **waker);

/** @brief Ends the current wait or read, or the next one. */
int conduit_ring_waker_wake(const conduit_ring_waker *waker);

/** @brief Frees a waker. Accepts NULL. */
void conduit_ring_waker_free(conduit_ring_waker *waker);

/* ---- Inspecting a topic -------------------------------------------------------------------- */

/** @brief `state`: the file contains an unknown state. */
#define CONDUIT_RING_STATE_UNKNOWN 0u
/** @brief `state`: the publisher is alive. */
#define CONDUIT_RING_STATE_LIVE 1u
/** @brief `state`: the publisher has closed the topic. */
#define CONDUIT_RING_STATE_CLOSED 2u
/** @brief `state`: a topic of another geometry has replaced this one. */
#define CONDUIT_RING_STATE_RETIRED 3u
/** @brief `state`: the publisher died; the next one takes over. */
#define CONDUIT_RING_STATE_DEAD 4u
/** @brief `state`: from a publisher without the extension, which may be alive or dead. */
#define CONDUIT_RING_STATE_LEGACY 5u

/** @brief The number of reader slots. */
#define CONDUIT_RING_READERS 16u

/** @brief A claimed reader slot. */
typedef struct conduit_ring_reader {
    uint32_t index;  /**< The slot's index. */
    uint32_t pid;
    bool is_native;  /**< Uses the extension. If not, only index and next_sequence are valid. */
    bool is_alive;   /**< A native reader that is alive. A dead one has leaked its slot. */
    bool is_waiting; /**< Sleeps until a message arrives. */
    uint64_t next_sequence;
    uint64_t lost;
} conduit_ring_reader;

/** @brief The state of a topic at one time. */
typedef struct conduit_ring_info {
    conduit_ring_geometry geometry;
    uint32_t max_message_size_bytes;
    uint32_t state;             /**< CONDUIT_RING_STATE_... */
    uint32_t epoch;             /**< Number of takeovers. */
    uint32_t writer_pid;
    uint64_t published;         /**< Number of messages, which is the next sequence number. */
    uint64_t content_tag;       /**< Hash of the encoding's name; 0 for raw bytes. */
    uint64_t instance_id;       /**< Random number of this file; 0 without the extension. */
    uint64_t last_publish_ns;   /**< 0 before the first message. */
    int64_t realtime_offset_ns; /**< Difference to wall time at the publisher's start. */
    uint64_t dropped_pinned;    /**< Skipped numbers and dropped messages due to held slots. */
    uint64_t rejected_oversize;
    uint64_t wake_count;        /**< How often the publisher woke sleeping readers. */
    uint32_t reader_count;      /**< Number of valid entries in `readers`. */
    conduit_ring_reader readers[CONDUIT_RING_READERS];
} conduit_ring_info;

/**
 * @brief Reads the state of a topic from outside: writes nothing and takes no reader slot.
 * @return 0, -ENOENT or -EPROTO.
 */
int conduit_ring_topic_info(const char *topic, conduit_ring_info *info);

/** @brief Reads the state of the publisher's own topic. */
int conduit_ring_publisher_info(conduit_ring_publisher *publisher, conduit_ring_info *info);

/**
 * @brief Returns the tag of an encoding's name: its 64-bit FNV-1a hash, or 0 for NULL and for
 * text that is not UTF-8.
 */
uint64_t conduit_ring_content_tag(const char *content);

#ifdef __cplusplus
}
#endif

#endif
