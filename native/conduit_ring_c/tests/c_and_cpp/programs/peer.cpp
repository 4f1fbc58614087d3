// usage: peer publish TOPIC COUNT    prints "open", waits for a line, publishes messages
//                                    0..COUNT, waits for the end of input
//        peer subscribe TOPIC COUNT  prints "ready", reads messages 0..COUNT, prints "whole"
//        peer flood TOPIC 0          publishes without end; message n has sequence number n
//        peer follow TOPIC COUNT     prints "ready", "following" after the first message and
//                                    "whole" after COUNT, across restarts of the publisher
//        peer node TOPIC 0           a node with loops and subscriptions: prints "running"; when
//                                    run() has returned, "joined" and the number of threads left
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <stdexcept>
#include <string>
#include <thread>

#include <conduit_core/node.hpp>
#include <conduit_core/pubsub.hpp>

#include "checked.h"

using conduit::Message;

namespace {

void check(bool holds, const char* what) {
  if (!holds) throw std::runtime_error(what);
}

void say(const std::string& line) { std::cout << line << std::endl; }

void publish_checked(conduit::Publisher& publisher, std::uint64_t n) {
  unsigned char message[CHECKED_LONGEST];
  check(publisher.publish(message, checked_fill(message, n)), "too long");
}

std::uint64_t number_of(const Message& message) {
  std::uint64_t n = 0;
  check(checked_is_whole(message.data(), message.size(), &n), "torn");
  return n;
}

void publish(const std::string& topic, std::uint64_t count) {
  conduit::Publisher publisher(topic, {1024, 4096});
  say("open");
  std::string line;
  std::getline(std::cin, line);
  for (std::uint64_t n = 0; n < count; ++n) publish_checked(publisher, n);
  while (std::getline(std::cin, line)) {
  }
}

void subscribe(const std::string& topic, std::uint64_t count) {
  conduit::Subscriber subscriber(topic);
  say("ready");
  for (std::uint64_t expected = 0; expected < count; ++expected) {
    const Message message = subscriber.wait();
    check(number_of(message) == expected && message.sequence() == expected
        && message.lost() == 0, "not the next one");
  }
  say("whole");
}

void flood(const std::string& topic) {
  conduit::Publisher publisher(topic, {64, 4096});
  conduit_ring_info info;
  check(conduit_ring_topic_info(topic.c_str(), &info) == 0, "info");
  for (std::uint64_t n = info.published;; ++n) {
    publish_checked(publisher, n);
    std::this_thread::sleep_for(std::chrono::microseconds(100));
  }
}

void follow(const std::string& topic, std::uint64_t count) {
  conduit::Subscriber subscriber(topic);
  say("ready");
  std::uint64_t next = 0;
  for (std::uint64_t i = 0; i < count; ++i) {
    const Message message = subscriber.wait();
    check(number_of(message) == message.sequence(), "the sequence number of another message");
    check(i == 0 || message.sequence() == next + message.lost(),
        "a number used twice, or a loss that is not told");
    next = message.sequence() + 1;
    if (i == 0) say("following");
  }
  say("whole");
}

class Busy : public conduit::Node {
public:
  explicit Busy(const std::string& topic) : out_(advertise(topic)) {
    subscribe(topic, &Busy::on_message);
    subscribe(topic + ".silent", &Busy::on_message);
    loop(500.0, &Busy::tick);
    loop(0.001, &Busy::rarely);
  }

private:
  void tick() { out_.publish("tick", 4); }
  void rarely() {}
  void on_message(const Message&) {
    if (!running_.exchange(true)) say("running");
  }

  conduit::Publisher out_;
  std::atomic<bool> running_{false};
};

std::ptrdiff_t threads() {
  using Tasks = std::filesystem::directory_iterator;
  return std::distance(Tasks("/proc/self/task"), Tasks());
}

void node(const std::string& topic) {
  Busy busy(topic);
  busy.run();
  // A thread that was joined is counted until the kernel has buried it.
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  while (threads() > 1 && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
  say("joined " + std::to_string(threads()));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  const std::string verb = argv[1];
  const std::string topic = argv[2];
  const std::uint64_t count = std::strtoull(argv[3], nullptr, 10);
  try {
    if (verb == "publish") publish(topic, count);
    else if (verb == "subscribe") subscribe(topic, count);
    else if (verb == "flood") flood(topic);
    else if (verb == "follow") follow(topic, count);
    else node(topic);
  } catch (const std::exception& thrown) {
    std::cerr << "peer.cpp: " << thrown.what() << std::endl;
    return 1;
  }
}
