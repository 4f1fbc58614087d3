/// @file
/// A program of publishers, subscriptions and loops. Derive from Node, set them up in the
/// constructor, and call run().
///
///     class Talker : public conduit::Node {
///     public:
///       Talker() : chatter_(advertise("chatter")) { loop(1.0, &Talker::tick); }
///     private:
///       void tick() { chatter_.publish("hello", 5); }
///       conduit::Publisher chatter_;
///     };
///     int main() { Talker().run(); }
///
/// Threads: each subscription and each loop has its own thread while run() runs. The callbacks of
/// a node run at the same time, so the data that they share needs a lock (a Publisher has its
/// own). A callback never runs twice at a time.
///
/// Exceptions: the node logs an exception of a callback as an error, at most once per second for
/// each callback, and continues with the next message or tick. A callback calls stop() to end the
/// program.
///
/// Several nodes in a process: call run() of each in its own thread. SIGINT or SIGTERM ends all.
#pragma once

#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include <poll.h>

#include "detail/error_log.hpp"
#include "detail/reader.hpp"
#include "detail/schedule.hpp"
#include "detail/signals.hpp"
#include "log.hpp"
#include "message.hpp"
#include "pubsub.hpp"

namespace conduit {

/// The base class of a program. See the description of this file.
class Node {
public:
  /// Lets a derived class in another namespace use the name unqualified, like advertise().
  using RingBufferConfig = ::conduit::RingBufferConfig;

  Node() = default;
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  /// Ends a run() that is still running in another thread and waits for it. The derived class is
  /// destroyed by then, so call stop() and wait for the end of run() before.
  virtual ~Node() {
    std::unique_lock<std::mutex> lock(mutex_);
    if (!running_) return;
    stop();
    changed_.wait(lock, [this] { return !running_; });
  }

  /// Creates a publisher, as the constructors of Publisher do.
  Publisher advertise(const std::string& topic) { return advertise(topic, RingBufferConfig{}); }
  Publisher advertise(const std::string& topic, const RingBufferConfig& config) {
    // run() checks the topic's name, so the publisher needs no thread for it.
    Publisher publisher(topic, config, CONDUIT_RING_NO_THREAD);
    const std::lock_guard<std::mutex> guard(mutex_);
    advertised_.push_back(publisher.handle_.get_deleter().shared);
    return publisher;
  }

  /// Calls `callback` with each message that is published from now on, while run() runs. The
  /// topic need not exist yet. Throws when the topic has 16 other subscribers.
  template <class T>
  void subscribe(const std::string& topic, void (T::*callback)(const Message&)) {
    subscribe(topic, [this, callback](const Message& message) {
      (self<T>().*callback)(message);
    });
  }

  template <class T>
  void subscribe(const std::string& topic, void (T::*callback)(const Message&) const) {
    subscribe(topic, [this, callback](const Message& message) {
      (self<T>().*callback)(message);
    });
  }

  template <class Callback,
            std::enable_if_t<std::is_invocable_v<Callback&, const Message&>, int> = 0>
  void subscribe(const std::string& topic, Callback callback) {
    auto reader = std::make_shared<detail::Reader>(topic);
    std::function<void(const Message&)> function(std::move(callback));
    auto body = [this, reader, function = std::move(function)] { read(*reader, function); };
    add({std::move(body), [reader] { reader->wake(); }, {}});
  }

  /// Calls `callback` `hz` times per second while run() runs, the first time at once. A tick that
  /// takes longer than its period delays the next one; ticks missed by a whole period are
  /// skipped.
  template <class T>
  void loop(double hz, void (T::*callback)()) {
    loop(hz, [this, callback] { (self<T>().*callback)(); });
  }

  template <class T>
  void loop(double hz, void (T::*callback)() const) {
    loop(hz, [this, callback] { (self<T>().*callback)(); });
  }

  template <class Callback, std::enable_if_t<std::is_invocable_v<Callback&>, int> = 0>
  void loop(double hz, Callback callback) {
    detail::Schedule::checked(hz);
    std::function<void()> function(std::move(callback));
    auto body = [this, hz, function = std::move(function)] { tick(hz, function); };
    add({std::move(body), [] {}, {}});
  }

  /// Calls the callbacks until SIGINT, SIGTERM or stop(), and returns when the last callback has
  /// returned. Handles these signals meanwhile.
  void run() {
    const detail::SignalWatch signals;
    begin();
    const Finish finish{*this};
    start_all();
    pollfd ends[] = {{signals.descriptor(), POLLIN, 0}, {stop_.descriptor(), POLLIN, 0}};
    for (;;) {
      const int ended = ::poll(ends, 2, check_period_ms);
      if (ended > 0 || (ended < 0 && errno != EINTR)) return;
      check_topics();
    }
  }

  /// Ends run(), or the next one if none runs. Any thread and any callback may call it. Does not
  /// wait.
  void stop() noexcept {
    stopping_.store(true);
    stop_.raise();
  }

private:
  using Clock = detail::Schedule::Clock;

  /// The period at which run() checks the names of the advertised topics.
  static constexpr int check_period_ms = 250;

  /// The pause after an error of a subscription.
  static constexpr std::chrono::milliseconds retry_pause{200};

  struct Worker {
    std::function<void()> body;
    std::function<void()> wake;
    std::thread thread;
  };

  /// Joins the threads, even when run() throws.
  struct Finish {
    Node& node;
    ~Finish() { node.finish(); }
  };

  template <class T>
  T& self() {
    static_assert(std::is_base_of_v<Node, T>, "expected a callback of the node's class");
    return static_cast<T&>(*this);
  }

  void add(Worker worker) {
    const std::lock_guard<std::mutex> guard(mutex_);
    workers_.push_back(std::make_unique<Worker>(std::move(worker)));
    if (running_ && !stopping_.load()) start(*workers_.back());
  }

  void begin() {
    const std::lock_guard<std::mutex> guard(mutex_);
    if (running_) throw std::logic_error("node is running already");
    running_ = true;
  }

  void start_all() {
    const std::lock_guard<std::mutex> guard(mutex_);
    for (const auto& worker : workers_) {
      if (!worker->thread.joinable()) start(*worker);
    }
  }

  static void start(Worker& worker) { worker.thread = std::thread(worker.body); }

  void finish() noexcept {
    stopping_.store(true);
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.notify_all();
    for (const auto& worker : workers_) worker->wake();
    // A callback may still add workers, which are not started any more.
    for (std::size_t i = 0; i < workers_.size(); ++i) {
      std::thread thread = std::move(workers_[i]->thread);
      if (!thread.joinable()) continue;
      lock.unlock();
      thread.join();
      lock.lock();
    }
    stop_.lower();
    stopping_.store(false);
    running_ = false;
    changed_.notify_all();
  }

  /// Creates removed files of topics again. Publishing returns the error if that fails.
  void check_topics() {
    for (const auto& publisher : open_publishers()) {
      conduit_ring_publisher_look_after(publisher.get());
    }
  }

  std::vector<std::shared_ptr<conduit_ring_publisher>> open_publishers() {
    const std::lock_guard<std::mutex> guard(mutex_);
    std::vector<std::shared_ptr<conduit_ring_publisher>> open;
    std::vector<std::weak_ptr<conduit_ring_publisher>> kept;
    for (const auto& advertised : advertised_) {
      if (auto publisher = advertised.lock()) {
        kept.push_back(advertised);
        open.push_back(std::move(publisher));
      }
    }
    advertised_ = std::move(kept);
    return open;
  }

  /// Waits until `deadline`. Returns false when the node stops.
  bool sleep_until(Clock::time_point deadline) {
    std::unique_lock<std::mutex> lock(mutex_);
    return !changed_.wait_until(lock, deadline, [this] { return stopping_.load(); });
  }

  void read(detail::Reader& reader, const std::function<void(const Message&)>& callback) {
    detail::ErrorLog callback_errors("callback of " + reader.topic());
    detail::ErrorLog reader_errors("subscription");
    while (!stopping_.load()) {
      auto event = detail::Event::nothing;
      const auto read = [&] { event = reader.read(std::chrono::nanoseconds::max()); };
      if (!reader_errors.run(read) && !sleep_until(Clock::now() + retry_pause)) return;
      handle(event, reader, callback, callback_errors);
    }
  }

  static void handle(detail::Event event, const detail::Reader& reader,
                     const std::function<void(const Message&)>& callback,
                     detail::ErrorLog& errors) {
    switch (event) {
      case detail::Event::message: errors.run([&] { callback(reader.message()); }); break;
      case detail::Event::publisher_down:
        log::warn("{}: publisher stopped; waiting for the next one", reader.topic());
        break;
      case detail::Event::publisher_up: log::info("{}: publisher started", reader.topic()); break;
      case detail::Event::nothing: break;
    }
  }

  void tick(double hz, const std::function<void()>& callback) {
    detail::ErrorLog errors("loop at " + detail::format("{}", hz) + " Hz");
    detail::Schedule schedule(hz, Clock::now());
    while (!stopping_.load()) {
      errors.run(callback);
      if (!sleep_until(schedule.next(Clock::now()))) return;
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::unique_ptr<Worker>> workers_;
  std::vector<std::weak_ptr<conduit_ring_publisher>> advertised_;
  detail::Flag stop_;
  std::atomic<bool> stopping_{false};
  bool running_ = false;
};

}  // namespace conduit
