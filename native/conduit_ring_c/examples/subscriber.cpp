// Reads the messages of publisher.cpp; may run before, during and after it.
#include <chrono>
#include <string_view>

#include <conduit_core/log.hpp>
#include <conduit_core/pubsub.hpp>

int main() {
  conduit::Subscriber subscriber("greetings");
  for (;;) {
    const auto message = subscriber.wait_for(std::chrono::seconds(1));
    if (!message) {
      conduit::log::warn("no message on {} for a second", subscriber.topic());
      continue;
    }
    const std::string_view text(static_cast<const char*>(message->data()), message->size());
    conduit::log::info("{} at {} ns: {}", message->sequence(), message->timestamp_ns(), text);
  }
}
