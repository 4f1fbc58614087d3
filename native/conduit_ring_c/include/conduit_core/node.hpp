/// A program that publishes, subscribes and ticks: subclass Node, wire it up in the constructor, call run().
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
/// Threads. Each subscription and each loop has a thread of its own, which lives while run() does: callbacks of one node
/// run at the same time, so what they share needs a lock (a Publisher has its own). One callback is never called twice
/// at a time.
///
/// Exceptions. What a callback throws is logged as an error, at most once a second for each callback, and the node goes
/// on with the next message or tick. A callback that wants to end the program calls stop().
///
/// Several nodes in one process: run() each in a thread of its own. SIGINT or SIGTERM ends them all.
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

#include "detail/complaints.hpp"
#include "detail/reader.hpp"
#include "detail/schedule.hpp"
#include "detail/signals.hpp"
#include "log.hpp"
#include "message.hpp"
#include "pubsub.hpp"

namespace conduit {

class Node {
public:
  /// So that a subclass in another namespace finds the name unqualified, beside advertise().
  using RingBufferConfig = ::conduit::RingBufferConfig;

  Node() = default;
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  /// Ends a run() that is still under way in another thread and waits for it. By then the subclass is gone: better stop()
  /// and wait for run() to return before.
  virtual ~Node() {
    std::unique_lock<std::mutex> lock(mutex_);
    if (!running_) return;
    stop();
    changed_.wait(lock, [this] { return !running_; });
  }

  /// As Publisher's constructors.
  Publisher advertise(const std::string& topic) { return advertise(topic, RingBufferConfig{}); }
  Publisher advertise(const std::string& topic, const RingBufferConfig& config) {
    // run() looks after it, without a thread.
    Publisher publisher(topic, config, CONDUIT_RING_NO_THREAD);
    const std::lock_guard<std::mutex> guard(mutex_);
    advertised_.push_back(publisher.handle_.get_deleter().shared);
    return publisher;
  }

  /// Calls `callback` with each message published from now on, once run() runs. The topic need not exist yet. Throws when
  /// 16 others read it.
  template <class T>
  void subscribe(const std::string& topic, void (T::*callback)(const Message&)) {
    subscribe(topic, [this, callback](const Message& message) { (self<T>().*callback)(message); });
  }

  template <class T>
  void subscribe(const std::string& topic, void (T::*callback)(const Message&) const) {
    subscribe(topic, [this, callback](const Message& message) { (self<T>().*callback)(message); });
  }

  template <class Callback, std::enable_if_t<std::is_invocable_v<Callback&, const Message&>, int> = 0>
  void subscribe(const std::string& topic, Callback callback) {
    auto reader = std::make_shared<detail::Reader>(topic);
    auto body = [this, reader, callback = std::function<void(const Message&)>(std::move(callback))] {
      read(*reader, callback);
    };
    add({std::move(body), [reader] { reader->wake(); }, {}});
  }

  /// Calls `callback` `hz` times a second while run() runs, the first time at once. A tick that takes longer than its
  /// period makes the next one late; ticks that were missed altogether are left out.
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
    auto body = [this, hz, callback = std::function<void()>(std::move(callback))] { tick(hz, callback); };
    add({std::move(body), [] {}, {}});
  }

  /// Calls the callbacks until SIGINT, SIGTERM or stop(), and returns when the last of them has returned. While it runs,
  /// these signals have its handler.
  void run() {
    const detail::SignalWatch signals;
    begin();
    const Finish finish{*this};
    start_all();
    pollfd ends[] = {{signals.descriptor(), POLLIN, 0}, {stop_.descriptor(), POLLIN, 0}};
    for (;;) {
      const int ended = ::poll(ends, 2, looks_ms);
      if (ended > 0 || (ended < 0 && errno != EINTR)) return;
      look_after_topics();
    }
  }

  /// Ends run(), or the next one if none runs. For any thread and any callback; does not wait.
  void stop() noexcept {
    stopping_.store(true);
    stop_.raise();
  }

private:
  using Clock = detail::Schedule::Clock;

  /// How often run() looks after the topics that were advertised.
  static constexpr int looks_ms = 250;

  struct Worker {
    std::function<void()> body;
    std::function<void()> wake;
    std::thread thread;
  };

  /// Joins the threads however run() ends.
  struct Finish {
    Node& node;
    ~Finish() { node.finish(); }
  };

  template <class T>
  T& self() {
    static_assert(std::is_base_of_v<Node, T>, "the callback must be a member of the node");
    return static_cast<T&>(*this);
  }

  void add(Worker worker) {
    const std::lock_guard<std::mutex> guard(mutex_);
    workers_.push_back(std::make_unique<Worker>(std::move(worker)));
    if (running_ && !stopping_.load()) start(*workers_.back());
  }

  void begin() {
    const std::lock_guard<std::mutex> guard(mutex_);
    if (running_) throw std::logic_error("run() of this node is running already");
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
    // A callback may still add workers, but they are not started any more.
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

  /// Makes files of topics anew that somebody removed. Whoever publishes is told what goes wrong.
  void look_after_topics() {
    for (const auto& publisher : living_publishers()) conduit_ring_publisher_look_after(publisher.get());
  }

  std::vector<std::shared_ptr<conduit_ring_publisher>> living_publishers() {
    const std::lock_guard<std::mutex> guard(mutex_);
    std::vector<std::shared_ptr<conduit_ring_publisher>> living;
    std::vector<std::weak_ptr<conduit_ring_publisher>> kept;
    for (const auto& advertised : advertised_) {
      if (auto publisher = advertised.lock()) {
        kept.push_back(advertised);
        living.push_back(std::move(publisher));
      }
    }
    advertised_ = std::move(kept);
    return living;
  }

  /// False when the node is to stop.
  bool sleep_until(Clock::time_point deadline) {
    std::unique_lock<std::mutex> lock(mutex_);
    return !changed_.wait_until(lock, deadline, [this] { return stopping_.load(); });
  }

  void read(detail::Reader& reader, const std::function<void(const Message&)>& callback) {
    detail::Complaints callback_complaints("callback of " + reader.topic());
    detail::Complaints reader_complaints("subscription");
    while (!stopping_.load()) {
      auto event = detail::Event::nothing;
      const auto look = [&] { event = reader.read(std::chrono::nanoseconds::max()); };
      if (!reader_complaints.logged(look) && !sleep_until(Clock::now() + std::chrono::milliseconds(200))) return;
      if (event == detail::Event::message) callback_complaints.logged([&] { callback(reader.message()); });
      if (event == detail::Event::publisher_down) log::warn("{}: no publisher any more; waiting for one", reader.topic());
      if (event == detail::Event::publisher_up) log::info("{}: has a publisher", reader.topic());
    }
  }

  void tick(double hz, const std::function<void()>& callback) {
    detail::Complaints complaints("loop at " + detail::format("{}", hz) + " Hz");
    detail::Schedule schedule(hz, Clock::now());
    while (!stopping_.load()) {
      complaints.logged(callback);
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
