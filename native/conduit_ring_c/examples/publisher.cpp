// A publisher with a configured ring: 8 slots for messages of up to 1004 bytes.
#include <chrono>
#include <cstdint>
#include <string>
#include <thread>

#include <conduit_core/log.hpp>
#include <conduit_core/pubsub.hpp>

int main() {
  conduit::RingBufferConfig config;
  config.slot_count = 8;
  config.slot_size = 1024;

  conduit::Publisher publisher("greetings", config);
  conduit::log::info("publishing on {}", publisher.topic());

  for (std::uint32_t count = 0;; ++count) {
    const std::string text = "greeting " + std::to_string(count);
    if (!publisher.publish(text.data(), text.size())) {
      conduit::log::warn("message of {} bytes does not fit", text.size());
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
}
