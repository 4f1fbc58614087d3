/// @file
/// The peer in C++, a Node. See README.md.
///
/// Usage: peer COUNT OWN OTHER...

#include <array>
#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <conduit_core/log.hpp>
#include <conduit_core/node.hpp>

namespace {

constexpr std::uint32_t SLOTS = 64;
constexpr std::uint64_t WINDOW = 16;
constexpr std::uint32_t HEADER = 20;
constexpr std::uint32_t LONGEST_BODY = 61'440;
constexpr std::uint32_t SLOT_HEADER = 20;

class Crc32 {
public:
  Crc32& add(const void* data, std::size_t size) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (std::size_t i = 0; i < size; ++i) crc_ = table()[(crc_ ^ bytes[i]) & 0xFF] ^ (crc_ >> 8);
    return *this;
  }

  std::uint32_t value() const { return ~crc_; }

private:
  static const std::array<std::uint32_t, 256>& table() {
    static const auto filled = [] {
      std::array<std::uint32_t, 256> entries{};
      for (std::uint32_t i = 0; i < 256; ++i) {
        std::uint32_t entry = i;
        for (int bit = 0; bit < 8; ++bit) {
          entry = (entry >> 1) ^ ((entry & 1) != 0 ? 0xEDB88320u : 0u);
        }
        entries[i] = entry;
      }
      return entries;
    }();
    return filled;
  }

  std::uint32_t crc_ = 0xFFFFFFFFu;
};

/// Returns message @p n of a topic.
std::vector<unsigned char> message(const std::string& topic, std::uint64_t n) {
  const std::uint32_t length = static_cast<std::uint32_t>(n * 2654435761u) % (LONGEST_BODY + 1);
  const std::uint64_t word = n * UINT64_C(0x9E3779B97F4A7C15);
  const std::uint32_t name = Crc32().add(topic.data(), topic.size()).value();
  std::vector<unsigned char> bytes(HEADER + length);
  std::memcpy(&bytes[0], &n, 8);
  std::memcpy(&bytes[8], &name, 4);
  std::memcpy(&bytes[12], &length, 4);
  for (std::uint32_t i = 0; i < length; ++i) {
    bytes[HEADER + i] = static_cast<unsigned char>(word >> (i % 8 * 8));
  }
  const std::uint32_t checksum =
      Crc32().add(bytes.data(), 16).add(bytes.data() + HEADER, length).value();
  std::memcpy(&bytes[16], &checksum, 4);
  return bytes;
}

void print_line(const std::string& line) { std::cout << line + "\n" << std::flush; }

class Peer : public conduit::Node {
public:
  Peer(std::uint64_t count, const std::string& own, const std::vector<std::string>& others)
      : count_(count), publisher_(advertise(own, {SLOTS, SLOT_HEADER + HEADER + LONGEST_BODY})) {
    for (const std::string& topic : others) {
      Other& other = others_.emplace_back(topic);
      subscribe(topic,
                [this, &other](const conduit::Message& received) { read(other, received); });
    }
    loop(1000.0, &Peer::publish);
  }

private:
  struct Other {
    explicit Other(std::string name) : topic(std::move(name)) {}
    std::string topic;
    std::uint64_t bytes = 0;
    std::atomic<std::uint64_t> read{0};
  };

  void publish() {
    for (; next_ < count_; ++next_) {
      for (const Other& other : others_) {
        if (other.read.load() + WINDOW <= next_) return;
      }
      const auto bytes = message(publisher_.topic(), next_);
      if (!publisher_.publish(bytes.data(), bytes.size())) {
        fail("message " + std::to_string(next_) + " was not published");
      }
    }
  }

  void read(Other& other, const conduit::Message& received) {
    const std::uint64_t n = other.read.load();
    const auto expected = message(other.topic, n);
    const bool is_intact = received.size() == expected.size() &&
                           std::memcmp(received.data(), expected.data(), expected.size()) == 0;
    if (received.lost() != 0 || received.sequence() != n || !is_intact) {
      std::ostringstream error;
      error << other.topic << ": expected message " << n << ", got: message "
            << received.sequence() << (is_intact ? "" : " with other bytes") << ", lost "
            << received.lost();
      fail(error.str());
    }
    other.bytes += received.size();
    other.read.store(n + 1);
    if (n + 1 == count_) {
      print_line("verified " + other.topic + " " + std::to_string(n + 1) + " " +
                 std::to_string(other.bytes));
    }
  }

  [[noreturn]] static void fail(const std::string& error) {
    std::cerr << "c++: " << error << std::endl;
    std::_Exit(1);
  }

  std::uint64_t count_;
  std::uint64_t next_ = 0;
  std::deque<Other> others_;
  conduit::Publisher publisher_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  try {
    Peer peer(std::strtoull(argv[1], nullptr, 10), argv[2],
              std::vector<std::string>(argv + 3, argv + argc));
    print_line("ready");
    std::string line;
    std::getline(std::cin, line);
    std::thread end([&peer] {
      std::string last;
      std::getline(std::cin, last);
      peer.stop();
    });
    peer.run();
    end.join();
  } catch (const std::exception& error) {
    std::cerr << "c++: " << error.what() << std::endl;
    return 1;
  }
}
