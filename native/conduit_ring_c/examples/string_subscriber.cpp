// A node that prints each text that string_publisher.cpp publishes.
#include <string_view>

#include <conduit_core/log.hpp>
#include <conduit_core/node.hpp>

class Listener : public conduit::Node {
public:
  Listener() { subscribe("chatter", &Listener::on_message); }

private:
  void on_message(const conduit::Message& message) {
    conduit::log::info("heard: {}", std::string_view(static_cast<const char*>(message.data()), message.size()));
  }
};

int main() {
  Listener node;
  node.run();
}
