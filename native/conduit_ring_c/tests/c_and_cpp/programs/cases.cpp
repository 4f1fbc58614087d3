// usage: cases NAME TOPIC - runs one case; the exit status is 0 if it passes.
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <future>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <conduit_core/log.hpp>
#include <conduit_core/node.hpp>
#include <conduit_core/pubsub.hpp>

#include "wire_format.h"

using namespace std::chrono_literals;
using conduit::Message;
using conduit::Node;
using conduit::Publisher;
using conduit::RingBufferConfig;
using conduit::Subscriber;

/// Whether this is a forked child. It has the memory of its parent's threads without the threads,
/// which is not a leak.
static bool is_child = false;
extern "C" int __lsan_is_turned_off();
extern "C" int __lsan_is_turned_off() { return is_child; }

namespace {

[[noreturn]] void fail(int line, const std::string& what) {
  std::fprintf(stderr, "line %d: %s\n", line, what.c_str());
  std::_Exit(1);
}

#define CHECK(condition) ((condition) ? void() : fail(__LINE__, #condition))

template <class Exception, class Call>
std::string thrown(int line, Call&& call) {
  try {
    call();
  } catch (const Exception& exception) {
    return exception.what();
  }
  fail(line, "nothing was thrown");
}
#define THROWS(Exception, message, call) \
  CHECK((thrown<Exception>(__LINE__, [&] { (void)call; }).find(message) != std::string::npos))

std::string topic;

std::string text_of(const Message& message) {
  return std::string(static_cast<const char*>(message.data()), message.size());
}

bool publish(Publisher& publisher, std::string_view text) {
  return publisher.publish(text.data(), text.size());
}

// The guaranteed properties of the types.
static_assert(!std::is_default_constructible_v<Publisher>);
static_assert(std::is_nothrow_move_constructible_v<Publisher>
    && std::is_nothrow_move_assignable_v<Publisher>);
static_assert(!std::is_copy_constructible_v<Publisher>);
static_assert(std::is_constructible_v<Publisher, const std::string&>);
static_assert(std::is_constructible_v<Publisher, const std::string&, const RingBufferConfig&>);
static_assert(std::is_same_v<decltype(&Publisher::publish),
    bool (Publisher::*)(const void*, std::size_t)>);
static_assert(std::is_same_v<decltype(std::declval<Subscriber&>().wait()), Message>);
static_assert(std::is_same_v<decltype(std::declval<Subscriber&>().try_read()),
    std::optional<Message>>);
static_assert(std::is_same_v<decltype(std::declval<Subscriber&>().wait_for(1s)),
    std::optional<Message>>);
static_assert(std::is_same_v<decltype(std::declval<const Publisher&>().topic()),
    const std::string&>);
static_assert(std::is_same_v<decltype(std::declval<const Subscriber&>().topic()),
    const std::string&>);
static_assert(std::is_same_v<decltype(std::declval<const Message&>().sequence()), std::uint64_t>);
static_assert(std::is_same_v<decltype(std::declval<Node&>().advertise("")), Publisher>);
static_assert(std::is_same_v<decltype(std::declval<Node&>().advertise("", RingBufferConfig{})),
    Publisher>);

void messages_arrive_in_order() {
  Publisher publisher(topic);
  CHECK(publisher.topic() == topic);
  Subscriber subscriber(topic);
  CHECK(subscriber.topic() == topic);
  for (std::uint64_t n = 0; n < 10; ++n) {
    CHECK(publish(publisher, "no " + std::to_string(n)));
    const Message message = subscriber.wait();
    CHECK(text_of(message) == "no " + std::to_string(n));
    CHECK(message.sequence() == n && message.lost() == 0);
    CHECK(message.timestamp_ns() > 0 && message.timestamp_ns() <= conduit_ring_clock_now_ns());
  }
}

void a_message_does_not_change_after_the_publisher_laps() {
  Publisher publisher(topic, {4, 1024});
  Subscriber subscriber(topic);
  const std::string first(1000, 'a');
  publish(publisher, first);
  const Message message = subscriber.wait();
  for (int i = 0; i < 100; ++i) publish(publisher, std::string(1000, 'b'));
  CHECK(text_of(message) == first && message.sequence() == 0);
  const Message next = subscriber.wait();
  CHECK(next.sequence() == 97 && next.lost() == 96);
}

void wait_for_ends_in_time() {
  Publisher publisher(topic);
  Subscriber subscriber(topic);
  const auto before = std::chrono::steady_clock::now();
  CHECK(!subscriber.wait_for(30ms));
  CHECK(std::chrono::steady_clock::now() - before >= 30ms);
  CHECK(!subscriber.wait_for(0ns));
  CHECK(!subscriber.wait_for(-5s));
  publish(publisher, "x");
  CHECK(subscriber.wait_for(std::chrono::hours(24)));
  publish(publisher, "y");
  CHECK(subscriber.wait_for(std::chrono::nanoseconds::max()));
}

void try_read_does_not_wait() {
  Publisher publisher(topic);
  Subscriber subscriber(topic);
  CHECK(!subscriber.try_read());
  publish(publisher, "");
  const auto message = subscriber.try_read();
  CHECK(message && message->size() == 0);
  CHECK(!subscriber.try_read());
}

void a_message_that_does_not_fit_is_false() {
  Publisher publisher(topic);
  Subscriber subscriber(topic);
  const std::vector<char> bytes(5000);
  CHECK(!publisher.publish(bytes.data(), 4077));
  CHECK(!subscriber.try_read());
  CHECK(publisher.publish(bytes.data(), 4076));
  CHECK(subscriber.wait().size() == 4076);
}

void a_second_live_publisher_throws() {
  auto publisher = std::make_unique<Publisher>(topic);
  THROWS(std::runtime_error, topic, Publisher(topic));
  THROWS(std::system_error, std::to_string(::getpid()), Publisher(topic, {8, 64}));
  try {
    Publisher second(topic);
  } catch (const std::system_error& error) {
    CHECK(error.code() == std::errc::device_or_resource_busy);
  }
  publisher.reset();
  Publisher again(topic);
}

void invalid_names_and_geometries_throw_a_message() {
  THROWS(std::runtime_error, "a/b", Publisher("a/b"));
  THROWS(std::runtime_error, "expected a topic name", Subscriber(""));
  THROWS(std::runtime_error, "NUL", Publisher(std::string("a\0b", 3)));
  THROWS(std::runtime_error, "12 slots", Publisher(topic, {12, 4096}));
  THROWS(std::runtime_error, "20 bytes", Publisher(topic, {16, 20}));
}

void publishers_and_subscribers_can_be_moved() {
  Publisher publisher(topic);
  Subscriber subscriber(topic);
  publish(publisher, "kept");
  const Message message = subscriber.wait();
  Publisher elsewhere = std::move(publisher);
  Subscriber other(std::move(subscriber));
  CHECK(text_of(message) == "kept");
  publish(elsewhere, "moved");
  CHECK(text_of(other.wait()) == "moved");
  CHECK(elsewhere.topic() == topic && other.topic() == topic);
  Publisher second(topic + "b");
  second = std::move(elsewhere);
  Publisher freed(topic + "b");
  publish(second, "assigned");
  CHECK(text_of(other.wait()) == "assigned");
}

void a_subscriber_waits_until_the_topic_exists() {
  std::atomic<bool> constructed{false};
  std::thread reader([&] {
    Subscriber subscriber(topic);
    constructed = true;
    CHECK(text_of(subscriber.wait()) == "first");
  });
  std::this_thread::sleep_for(20ms);
  CHECK(!constructed);
  Publisher publisher(topic);
  publish(publisher, "first");
  reader.join();
}

void a_subscriber_outlives_its_publisher() {
  std::optional<Publisher> publisher(topic);
  Subscriber subscriber(topic);
  for (int life = 0; life < 3; ++life) {
    const std::string text = "life " + std::to_string(life);
    publish(*publisher, text);
    CHECK(text_of(subscriber.wait()) == text);
    publish(*publisher, "last words");
    publisher.reset();
    CHECK(text_of(subscriber.wait()) == "last words");
    CHECK(!subscriber.wait_for(1ms));
    publisher.emplace(topic, RingBufferConfig{4, 64U << life});
  }
}

void a_seventeenth_subscriber_throws() {
  Publisher publisher(topic);
  std::vector<Subscriber> sixteen;
  for (int i = 0; i < 16; ++i) sixteen.emplace_back(topic);
  THROWS(std::runtime_error, "16 reader slots", Subscriber(topic));
  Node node;
  THROWS(std::runtime_error, "16 reader slots", node.subscribe(topic, [](const Message&) {}));
  sixteen.pop_back();
  Subscriber seventeenth(topic);
}

void two_threads_share_a_publisher() {
  constexpr std::size_t each = 2000;
  Publisher publisher(topic, {4096, 128});
  Subscriber subscriber(topic);
  const auto flood = [&](char c) {
    for (std::size_t n = 0; n < each; ++n) CHECK(publish(publisher, std::string(1 + n % 100, c)));
  };
  std::thread a(flood, 'a');
  std::thread b(flood, 'b');
  a.join();
  b.join();
  std::map<char, std::size_t> counts;
  for (std::size_t n = 0; n < 2 * each; ++n) {
    const std::string text = text_of(subscriber.wait());
    CHECK(text.find_first_not_of(text[0]) == std::string::npos);
    CHECK(text.size() == 1 + counts[text[0]]++ % 100);
  }
  CHECK(counts['a'] == each && counts['b'] == each);
}

enum class Colour : unsigned char { red = 3 };
struct Point {
  int x, y;
};
std::ostream& operator<<(std::ostream& out, const Point& point) {
  return out << point.x << '/' << point.y;
}

/// Returns what `log` writes on standard error.
std::string logged(const std::function<void()>& log) {
  int ends[2];
  CHECK(::pipe(ends) == 0);
  const int kept = ::dup(STDERR_FILENO);
  ::dup2(ends[1], STDERR_FILENO);
  ::close(ends[1]);
  log();
  ::dup2(kept, STDERR_FILENO);
  ::close(kept);
  std::string text(65536, '\0');
  const ssize_t size = ::read(ends[0], text.data(), text.size());
  ::close(ends[0]);
  text.resize(static_cast<std::size_t>(size));
  return text;
}

void log_lines_are_formatted() {
  using conduit::detail::format;
  CHECK(format("plain") == "plain");
  CHECK(format("{} and {}", 1, "two") == "1 and two");
  CHECK(format("{}{}{}", std::string("a"), std::string_view("b"), 'c') == "abc");
  CHECK(format("{} {} {}", true, std::uint8_t{7}, std::int8_t{-7}) == "true 7 -7");
  CHECK(format("{} {}", Colour::red, Point{1, 2}) == "3 1/2");
  CHECK(format("{}", static_cast<const char*>(nullptr)) == "(null)");
  CHECK(format("{} {} {}", 0.1, 0.1F, 1e21) == "0.1 0.1 1e+21");
  CHECK(format("{:.3f}|{:8.2f}|{:e}", 3.14159, 2.5, 12345.678) == "3.142|    2.50|1.234568e+04");
  CHECK(format("{:x}|{:#x}|{:04x}|{:X}|{:o}|{:#b}", 255, 255, 255, 255, 8, 5)
      == "ff|0xff|00ff|FF|10|0b101");
  CHECK(format("{:5}|{:<5}|{:>5}|{:05}|{:*>5}", 42, 42, "ab", -42, 7)
      == "   42|42   |   ab|-0042|****7");
  CHECK(format("{:5}|{:^6}|{:-^7}|{:*^4}", "ab", "ab", 1.5, 'x') == "ab   |  ab  |--1.5--|*x**");
  CHECK(format("{:+} {: } {:+.1f} {:+}", 7, 7, 0.25, -7) == "+7  7 +0.2 -7");
  CHECK(format("{:06.2f}|{:+06}|{:#06x}", -1.5, 7, 255) == "-01.50|+00007|0x00ff");
  CHECK(format("{:.2}|{:5.1}|{:.3}", "abcdef", "xyz", 3.14159) == "ab|x    |3.14");
  CHECK(format("{1} {0} {1}", "a", 'b') == "b a b");
  CHECK(format("{:d} {:d} {:c}", true, 'A', 66) == "1 65 B");
  CHECK(format("{} {} {}", 200.0, 0.1 + 0.2, -0.0) == "200 0.30000000000000004 -0");
  CHECK(format("{} {} {:F}", 1.0 / 0.0, -1.0 / 0.0, 0.0 / 0.0 > 0 ? 1.0 : 1.0 / 0.0)
      == "inf -inf INF");
  CHECK(format("{} {}", INT64_MIN, UINT64_MAX) == "-9223372036854775808 18446744073709551615");
  CHECK(format("{:p}", static_cast<void*>(nullptr)) == "0x0");
  CHECK(format("{:>5}|{:^5}", Point{1, 2}, "é") == "  1/2|  é  ");
  CHECK(format("{{}} {{{}}}", 1) == "{} {1}");
  CHECK(format("{}", 1, 2) == "1");

  // An invalid text throws. Without arguments it is returned unchanged.
  const char* const invalid[] = {"{} {}", "{",   "}",   "{:",      "{\"json\": {}}", "{:q}",
                                 "{:.}",  "{2}", "{0} {}", "{x}", "{:.2d}"};
  for (const char* wrong : invalid)
    thrown<std::exception>(__LINE__, [&] { static_cast<void>(format(wrong, 1)); });
  thrown<std::exception>(__LINE__, [&] { static_cast<void>(format("{:d}", "text")); });
  thrown<std::exception>(__LINE__, [&] { static_cast<void>(format("{:x}", 1.5)); });
  CHECK(format("{") == "{" && format("50 % of {\"json\": 1}") == "50 % of {\"json\": 1}"
      && format("{{}}") == "{}");

  const std::string refused = logged([] { conduit::log::warn("{:q} apples", 3); });
  CHECK(refused.find("warn: {:q} apples [not formatted: ") == 0 && refused.back() == '\n');
  CHECK(logged([] { conduit::log::info("{} tags", 3); }) == "info: 3 tags\n");
  CHECK(logged([] { conduit::log::warn("w"); conduit::log::error("e {}", 1); })
      == "warn: w\nerror: e 1\n");
  CHECK(logged([] { conduit::log::debug("hidden"); conduit::log::info(std::string("last")); })
      == "info: last\n");
}

void the_level_of_log_lines_can_be_set() {
  using conduit::log::Level;
  const auto all = [] {
    conduit::log::debug("d");
    conduit::log::info("i");
    conduit::log::warn("w");
    conduit::log::error("e");
  };
  CHECK(conduit::log::level() == Level::info);
  const std::pair<Level, const char*> lines[] = {
      {Level::debug, "debug: d\ninfo: i\nwarn: w\nerror: e\n"},
      {Level::info, "info: i\nwarn: w\nerror: e\n"},
      {Level::warn, "warn: w\nerror: e\n"},
      {Level::error, "error: e\n"}};
  for (const auto& [level, written] : lines) {
    conduit::log::set_level(level);
    CHECK(logged(all) == written);
  }
  conduit::log::set_level(Level::off);
  CHECK(logged([&] { all(); ::dprintf(STDERR_FILENO, "-"); }) == "-");
}

/// Uses the config's name unqualified, as programs written for these headers do.
class LargeMessages : public Node {
public:
  explicit LargeMessages(const std::string& topic) {
    RingBufferConfig config;
    config.slot_count = 4;
    config.slot_size = 2'100'000;
    pub_.emplace(advertise(topic, config));
  }

  bool publish(std::size_t size) { return pub_->publish(std::string(size, 'x').data(), size); }

private:
  std::optional<Publisher> pub_;
};

void a_node_configures_its_topics_for_large_messages() {
  LargeMessages node(topic);
  CHECK(node.publish(2'099'980));
  CHECK(!node.publish(2'099'981));
}

void schedules_neither_drift_nor_burst() {
  using conduit::detail::Schedule;
  const auto start = Schedule::Clock::now();
  Schedule steady(1000.0, start);
  for (int n = 1; n < 10000; ++n)
      CHECK(steady.next(start + (n - 1) * 1ms + 300us) == start + n * 1ms);
  Schedule late(100.0, start);
  CHECK(late.next(start + 1ms) == start + 10ms);
  CHECK(late.next(start + 25ms) == start + 20ms);
  CHECK(late.next(start + 26ms) == start + 30ms);
  CHECK(late.next(start + 95ms) == start + 90ms);
  CHECK(late.next(start + 95ms) == start + 100ms);
  Schedule third(3.0, start);
  CHECK(third.next(start) == start + 333333333ns);
  CHECK(third.next(start + 333333333ns) == start + 666666666ns);
}

struct Echo : Node {
  Publisher out;
  std::atomic<int> ticks{0};
  std::vector<std::string> heard;
  explicit Echo(const std::string& name) : out(advertise(name, RingBufferConfig{64, 128})) {
    subscribe(name, &Echo::on_message);
    loop(200.0, &Echo::tick);
  }
  void tick() { publish(out, "tick " + std::to_string(ticks++)); }
  void on_message(const Message& message) {
    heard.push_back(text_of(message));
    if (heard.size() == 5) stop();
  }
};

std::size_t threads() {
  std::size_t count = 0;
  std::FILE* status = std::fopen("/proc/self/status", "r");
  char line[256];
  while (std::fgets(line, sizeof line, status) != nullptr) {
    if (std::sscanf(line, "Threads: %zu", &count) == 1) break;
  }
  std::fclose(status);
  return count;
}

/// Waits for the kernel to remove joined threads, which it counts for a while.
bool are_joined_down_to(std::size_t count) {
  const auto deadline = std::chrono::steady_clock::now() + 10s;
  while (threads() > count && std::chrono::steady_clock::now() < deadline)
      std::this_thread::yield();
  return threads() == count;
}

void a_node_connects_publishers_loops_and_subscriptions() {
  const std::size_t before = threads();
  Echo node(topic);
  CHECK(threads() == before);
  node.run();
  CHECK(are_joined_down_to(before));
  CHECK(node.heard.size() >= 5 && node.heard[0] == "tick 0" && node.heard[4] == "tick 4");
}

struct Various : Node {
  mutable std::atomic<int> constant{0};
  std::atomic<int> lambda{0};
  std::atomic<int> noexcepts{0};
  Publisher out;
  explicit Various(const std::string& name) : out(advertise(name)) {
    subscribe(name, &Various::on_message);
    subscribe(name, [this](const Message&) { ++lambda; });
    subscribe(name, &Various::quietly);
    loop(1, &Various::tick);
    loop(200, [this] { if (constant > 0 && lambda > 0 && noexcepts > 0) stop(); });
  }
  void on_message(const Message&) const { ++constant; }
  void quietly(const Message&) noexcept { ++noexcepts; }
  void tick() { publish(out, "x"); }
};

void a_nodes_callbacks_may_be_const_functions_or_lambdas() { Various(topic).run(); }

struct Thrower : Node {
  Publisher out;
  int heard = 0;
  int ticks = 0;
  explicit Thrower(const std::string& name) : out(advertise(name)) {
    subscribe(name, &Thrower::on_message);
    loop(200, &Thrower::tick);
  }
  void on_message(const Message&) {
    if (++heard == 5) stop();
    throw std::runtime_error("message " + std::to_string(heard));
  }
  void tick() {
    publish(out, "x");
    ++ticks;
    throw 42;
  }
};

void an_exception_of_a_callback_is_logged_and_the_node_continues() {
  Thrower node(topic);
  const std::string log = logged([&] { node.run(); });
  CHECK(node.heard >= 5 && node.ticks >= 5);
  CHECK(log.find("error: callback of " + topic + ": message 1\n") != std::string::npos);
  const char* const unknown =
      "error: loop at 200 Hz: exception of a type other than std::exception\n";
  CHECK(log.find(unknown) != std::string::npos);
  CHECK(log.find("message 2") == std::string::npos);
}

void a_node_can_be_stopped_from_a_callback_and_run_again() {
  Echo node(topic);
  node.run();
  const std::size_t first = node.heard.size();
  std::thread stopper([&] { node.stop(); });
  node.run();
  stopper.join();
  CHECK(node.heard.size() >= first);
}

void a_node_that_was_stopped_before_does_not_run() {
  Echo node(topic);
  node.stop();
  node.run();
  CHECK(node.ticks == 0 && node.heard.empty());
}

void a_node_in_another_thread_is_joined_by_its_destructor() {
  const std::size_t before = threads();
  auto node = std::make_unique<Node>();
  std::promise<void> ticked;
  std::atomic<bool> once{false};
  node->loop(100, [&] { if (!once.exchange(true)) ticked.set_value(); });
  node->subscribe(topic, [](const Message&) {});
  std::thread runner([&, raw = node.get()] { raw->run(); });
  ticked.get_future().wait();
  node.reset();
  runner.join();
  CHECK(are_joined_down_to(before));
}

void one_signal_stops_several_nodes() {
  struct sigaction before = {};
  ::sigaction(SIGTERM, nullptr, &before);
  for (const int signal : {SIGTERM, SIGINT}) {
    std::atomic<int> running{0};
    Node a;
    Node b;
    for (Node* node : {&a, &b}) {
      node->loop(1, [&] { if (++running == 2) ::kill(::getpid(), signal); });
    }
    std::thread other([&] { a.run(); });
    b.run();
    other.join();
  }
  struct sigaction after = {};
  ::sigaction(SIGTERM, nullptr, &after);
  CHECK(after.sa_handler == before.sa_handler);
}

struct Grower : Node {
  Publisher out;
  explicit Grower(const std::string& name) : out(advertise(name)) { loop(100, &Grower::tick); }
  void tick() {
    if (!grown_) subscribe(out.topic(), [this](const Message&) { stop(); });
    grown_ = true;
    publish(out, "x");
  }

private:
  bool grown_ = false;
};

void callbacks_may_add_subscriptions() { Grower(topic).run(); }

void an_invalid_rate_throws() {
  Node node;
  for (const double hz
      : {0.0, -1.0, 1e-300, 1e10, std::nan(""), std::numeric_limits<double>::infinity()}) {
    THROWS(std::invalid_argument, "Hz", node.loop(hz, [] {}));
  }
}

void running_a_running_node_throws() {
  Node node;
  std::string sentence;
  node.loop(100, [&] {
    sentence = thrown<std::logic_error>(__LINE__, [&] { node.run(); });
    node.stop();
  });
  node.run();
  CHECK(sentence.find("running already") != std::string::npos);
}

static_assert(!std::is_copy_constructible_v<conduit::Lease>
    && std::is_nothrow_move_constructible_v<conduit::Lease>);
static_assert(!std::is_copy_constructible_v<conduit::Loan>
    && std::is_nothrow_move_constructible_v<conduit::Loan>);

std::string text_of(const conduit::Lease& lease) {
  return std::string(static_cast<const char*>(lease.data()), lease.size());
}

void a_lease_holds_its_message_until_it_is_destroyed() {
  Publisher publisher(topic, {4, 64});
  Subscriber subscriber(topic);
  CHECK(!subscriber.try_lease());
  CHECK(!subscriber.wait_lease_for(1ms));
  CHECK(publish(publisher, "first"));
  CHECK(text_of(subscriber.wait_lease()) == "first");
  CHECK(publish(publisher, "held"));
  {
    const auto lease = subscriber.try_lease();
    CHECK(lease && text_of(*lease) == "held" && lease->holds_slot());
    CHECK(lease->sequence() == 1 && lease->lost() == 0 && lease->timestamp_ns() > 0);
    for (int i = 0; i < 3; ++i) CHECK(publish(publisher, "other"));
    CHECK(publish(publisher, "behind it"));
    CHECK(text_of(*lease) == "held");
    // The number of the held slot is skipped, so that the oldest of the others is overwritten.
    for (int i = 0; i < 2; ++i) CHECK(text_of(subscriber.wait_lease()) == "other");
    const auto behind = subscriber.wait_lease();
    CHECK(text_of(behind) == "behind it" && behind.sequence() == 6 && behind.lost() == 1);
  }
  CHECK(publish(publisher, "after"));
}

void a_fourth_lease_throws() {
  Publisher publisher(topic);
  Subscriber subscriber(topic);
  std::vector<conduit::Lease> leases;
  for (int i = 0; i < 4; ++i) CHECK(publish(publisher, std::to_string(i)));
  for (int i = 0; i < 3; ++i) leases.push_back(subscriber.wait_lease());
  THROWS(std::system_error, "3 leases", subscriber.try_lease());
  leases.erase(leases.begin());
  CHECK(text_of(subscriber.wait_lease()) == "3");
}

void leases_can_be_moved_and_outlive_their_subscriber() {
  Publisher publisher(topic);
  std::optional<conduit::Lease> kept;
  {
    Subscriber subscriber(topic);
    CHECK(publish(publisher, "kept"));
    kept = subscriber.wait_lease();
  }
  const conduit::Lease moved = std::move(*kept);
  kept.reset();
  std::string text;
  std::thread([&] { text = text_of(moved); }).join();
  CHECK(text == "kept");
}

void a_loan_is_published_by_commit_and_not_otherwise() {
  Publisher publisher(topic, {4, 64});
  Subscriber subscriber(topic);
  CHECK(!publisher.loan(45));
  {
    auto loan = publisher.loan(8);
    CHECK(loan && loan->size() == 8);
    std::memcpy(loan->data(), "in place", 8);
    CHECK(!subscriber.try_read());
    THROWS(std::system_error, "loan", publish(publisher, "x"));
    conduit::Loan moved = std::move(*loan);
    THROWS(std::system_error, "moved from", loan->commit());
    THROWS(std::system_error, "got: 9", moved.commit(9));
    CHECK(moved.commit() == 0);
    THROWS(std::system_error, "was committed", moved.commit());
  }
  CHECK(text_of(subscriber.wait()) == "in place");
  {
    auto loan = publisher.loan(5);
    std::memcpy(loan->data(), "never", 5);
  }
  {
    auto loan = publisher.loan(44);
    std::memcpy(loan->data(), "short", 5);
    CHECK(loan->commit(5) == 1);
  }
  CHECK(text_of(subscriber.wait()) == "short");
  CHECK(!subscriber.try_read());
}

void a_loan_that_outlives_its_publisher_throws() {
  std::optional<Publisher> publisher;
  publisher.emplace(topic, RingBufferConfig{4, 64});
  Subscriber subscriber(topic);
  auto loan = publisher->loan(8);
  publisher.reset();
  std::memset(loan->data(), 'x', loan->size());
  THROWS(std::system_error, "ended its topic", loan->commit());

  // The topic is free, and an old loan does not disturb it.
  publisher.emplace(topic, RingBufferConfig{4, 64});
  auto other = publisher->loan(2);
  *publisher = Publisher(topic + "-other");
  THROWS(std::system_error, "ended its topic", other->commit());
  other.reset();
  loan.reset();
  Publisher last(topic, {4, 64});
  CHECK(publish(last, "last") && text_of(subscriber.wait()) == "last");
}

void a_child_leaves_the_topics_of_its_parent_alone() {
  std::optional<Publisher> publisher;
  publisher.emplace(topic, RingBufferConfig{4, 64});
  std::optional<Subscriber> subscriber(topic);
  std::optional<conduit::Lease> lease;
  CHECK(publish(*publisher, "held"));
  lease.emplace(subscriber->wait_lease());
  CHECK(publish(*publisher, "before"));

  const pid_t child = ::fork();
  if (child == 0) {
    is_child = true;
    THROWS(std::system_error, "forked", publish(*publisher, "from the child"));
    THROWS(std::system_error, "forked", static_cast<void>(publisher->loan(1)));
    THROWS(std::system_error, "forked", static_cast<void>(subscriber->try_read()));
    THROWS(std::system_error, "forked", static_cast<void>(subscriber->wait_for(1ms)));
    lease.reset();
    subscriber.reset();
    publisher.reset();
    std::exit(0);
  }
  int status = -1;
  CHECK(::waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);

  conduit_ring_info info{};
  CHECK(conduit_ring_topic_info(topic.c_str(), &info) == 0);
  CHECK(info.state == CONDUIT_RING_STATE_LIVE && info.reader_count == 1);
  CHECK(info.readers[0].is_alive);
  THROWS(std::system_error, "publishes this topic", Publisher(topic));
  CHECK(text_of(subscriber->wait()) == "before");
  CHECK(publish(*publisher, "after") && text_of(subscriber->wait()) == "after");
  for (int n = 0; n < 8; ++n) publish(*publisher, "more");
  CHECK(std::string(static_cast<const char*>(lease->data()), lease->size()) == "held");
}

/// Removes the topic's file and returns its name.
std::string removed() {
  const std::string path = "/dev/shm/conduit_" + topic;
  CHECK(::unlink(path.c_str()) == 0);
  return path;
}

void a_silent_publisher_creates_a_removed_file_again() {
  Publisher publisher(topic, {4, 64});
  Subscriber subscriber(topic);
  CHECK(publish(publisher, "before"));
  for (int n = 0; n < 3; ++n) {
    const std::string path = removed();
    for (int i = 0; i < 600 && ::access(path.c_str(), F_OK) != 0; ++i)
        std::this_thread::sleep_for(50ms);
    CHECK(::access(path.c_str(), F_OK) == 0);
  }
  THROWS(std::system_error, "publishes this topic", Publisher(topic));
  CHECK(publish(publisher, "after"));
  CHECK(text_of(subscriber.wait()) == "before");
  const auto after = subscriber.wait();
  CHECK(text_of(after) == "after" && after.sequence() == 1 && after.lost() == 0);
}

void a_silent_node_creates_its_removed_file_again() {
  struct Silent : Node {
    Silent() : publisher(advertise(topic)) {}
    Publisher publisher;
  };
  Silent node;
  std::thread running([&] { node.run(); });
  const std::string path = removed();
  for (int i = 0; i < 600 && ::access(path.c_str(), F_OK) != 0; ++i)
      std::this_thread::sleep_for(50ms);
  CHECK(::access(path.c_str(), F_OK) == 0);
  node.stop();
  running.join();
}

void a_publisher_reports_that_another_one_has_its_name() {
  Publisher publisher(topic, {4, 64});
  removed();
  // Either the other publisher is in time, or the file was created again before.
  std::optional<Publisher> other;
  for (int n = 0; n < 600 && !other; ++n) {
    try {
      other.emplace(topic, RingBufferConfig{4, 64});
    } catch (const conduit::Error& error) {
      CHECK(error.code().value() == EBUSY);
      removed();
    }
  }
  CHECK(other);
  bool lost = false;
  for (int n = 0; n < 600 && !lost; ++n) {
    std::this_thread::sleep_for(50ms);
    try {
      publish(publisher, "from the first");
    } catch (const conduit::Error& error) {
      lost = error.code().value() == ESTALE;
      CHECK(std::string(error.what()).find("publishes this topic") != std::string::npos);
    }
  }
  CHECK(lost);
  other.reset();
  bool back = false;
  for (int n = 0; n < 600 && !back; ++n) {
    std::this_thread::sleep_for(50ms);
    back = ::access(("/dev/shm/conduit_" + topic).c_str(), F_OK) == 0;
  }
  CHECK(back && publish(publisher, "again"));
}

void a_loan_survives_the_removal_of_the_file() {
  Publisher publisher(topic, {4, 64});
  Subscriber subscriber(topic);
  auto loan = publisher.loan(4);
  CHECK(loan);
  removed();
  // Time for a check of the name, which would move the publisher away from the lent memory.
  std::this_thread::sleep_for(700ms);
  std::memcpy(loan->data(), "lent", 4);
  CHECK(loan->commit() == 0);
  CHECK(text_of(subscriber.wait()) == "lent");
}

/// exit() destroys statics, in a child too, whatever the parent's threads did at the fork.
void a_child_that_exits_leaves_its_parents_statics_alone() {
  static Publisher publisher(topic, {4, 64});
  static Subscriber subscriber(topic);
  std::atomic<bool> done{false};
  std::thread busy([&] {
    while (!done) publish(publisher, "busy");
  });
  for (int n = 0; n < 50; ++n) {
    const pid_t child = ::fork();
    if (child == 0) {
      is_child = true;
      std::exit(0);
    }
    int status = -1;
    CHECK(::waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);
  }
  done = true;
  busy.join();
  THROWS(std::system_error, "publishes this topic", Publisher(topic));
  conduit_ring_info info{};
  CHECK(conduit_ring_topic_info(topic.c_str(), &info) == 0);
  CHECK(info.state == CONDUIT_RING_STATE_LIVE && info.reader_count == 1
      && info.readers[0].is_alive);
}

void a_guarded_subscriber_throws_when_the_file_is_truncated() {
  Publisher publisher(topic);
  Subscriber trusting(topic, conduit::Guard::never);
  Subscriber guarded(topic, conduit::Guard::always);
  CHECK(publish(publisher, "one"));
  CHECK(text_of(trusting.wait()) == "one");
  CHECK(text_of(guarded.wait()) == "one");
  CHECK(publish(publisher, "two"));
  CHECK(text_of(trusting.wait()) == "two");
  // Keeps the bytes of the header and removes those of slots.
  const std::string path = "/dev/shm/conduit_" + topic;
  CHECK(::truncate(path.c_str(), 1216) == 0);
  THROWS(std::system_error, "conduit_", guarded.try_read());
}

#pragma pack(push, 1)
struct FrameHeader {
  std::uint16_t magic;
  std::uint8_t version, flags;
  std::uint32_t width, height;
  char fourcc[4];
  std::uint32_t stride, data_size;
  std::uint64_t timestamp_ns;
  std::uint8_t clock_id, plane_count, rotation, colourspace;
  std::uint32_t frame_id, exposure_us;
};
#pragma pack(pop)

void a_camera_frame_has_the_layout_of_the_wire_format() {
  unsigned char shown[64];
  const std::size_t size = wire_format_read("frame_header", shown, sizeof shown);
  CHECK(size == sizeof(FrameHeader));
  Publisher publisher(topic);
  Subscriber subscriber(topic);
  CHECK(publisher.publish(shown, size));
  const Message message = subscriber.wait();
  FrameHeader header;
  CHECK(message.size() == sizeof header);
  std::memcpy(&header, message.data(), sizeof header);
  CHECK(header.magic == 0x4D43 && header.version == 1 && header.flags == 0);
  CHECK(header.width == 640 && header.height == 480
      && std::memcmp(header.fourcc, "GREY", 4) == 0);
  CHECK(header.stride == 704 && header.data_size == 704 * 480
      && header.timestamp_ns == 123456789012345u);
  CHECK(header.clock_id == 4 && header.plane_count == 1 && header.rotation == 2
      && header.colourspace == 3);
  CHECK(header.frame_id == 0xFFFFFFFFu && header.exposure_us == 8333);
}

#define CASE(name) {#name, name}
const std::map<std::string, void (*)()> cases = {
    CASE(messages_arrive_in_order),
    CASE(a_message_does_not_change_after_the_publisher_laps),
    CASE(wait_for_ends_in_time),
    CASE(try_read_does_not_wait),
    CASE(a_message_that_does_not_fit_is_false),
    CASE(a_second_live_publisher_throws),
    CASE(invalid_names_and_geometries_throw_a_message),
    CASE(publishers_and_subscribers_can_be_moved),
    CASE(a_subscriber_waits_until_the_topic_exists),
    CASE(a_subscriber_outlives_its_publisher),
    CASE(a_seventeenth_subscriber_throws),
    CASE(two_threads_share_a_publisher),
    CASE(log_lines_are_formatted),
    CASE(the_level_of_log_lines_can_be_set),
    CASE(a_node_configures_its_topics_for_large_messages),
    CASE(schedules_neither_drift_nor_burst),
    CASE(a_node_connects_publishers_loops_and_subscriptions),
    CASE(a_nodes_callbacks_may_be_const_functions_or_lambdas),
    CASE(an_exception_of_a_callback_is_logged_and_the_node_continues),
    CASE(a_node_can_be_stopped_from_a_callback_and_run_again),
    CASE(a_node_that_was_stopped_before_does_not_run),
    CASE(a_node_in_another_thread_is_joined_by_its_destructor),
    CASE(one_signal_stops_several_nodes),
    CASE(callbacks_may_add_subscriptions),
    CASE(an_invalid_rate_throws),
    CASE(a_lease_holds_its_message_until_it_is_destroyed),
    CASE(a_fourth_lease_throws),
    CASE(leases_can_be_moved_and_outlive_their_subscriber),
    CASE(a_loan_is_published_by_commit_and_not_otherwise),
    CASE(a_loan_that_outlives_its_publisher_throws),
    CASE(a_child_leaves_the_topics_of_its_parent_alone),
    CASE(a_silent_publisher_creates_a_removed_file_again),
    CASE(a_silent_node_creates_its_removed_file_again),
    CASE(a_publisher_reports_that_another_one_has_its_name),
    CASE(a_loan_survives_the_removal_of_the_file),
    CASE(a_child_that_exits_leaves_its_parents_statics_alone),
    CASE(a_guarded_subscriber_throws_when_the_file_is_truncated),
    CASE(a_camera_frame_has_the_layout_of_the_wire_format),
    CASE(running_a_running_node_throws),
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  topic = argv[2];
  const auto found = cases.find(argv[1]);
  if (found == cases.end()) {
    std::fprintf(stderr, "there is no case %s\n", argv[1]);
    return 2;
  }
  found->second();
  return 0;
}
