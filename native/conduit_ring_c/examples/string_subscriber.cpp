// A node that prints the texts of string_publisher.cpp.
#include <string_view>

#include <conduit_core/log.hpp>
#include <conduit_core/node.hpp>

class Listener : public conduit::Node {
public:
  Listener() { subscribe("chatter", &Listener::on_message); }

private:
  void on_message(const conduit::Message& message) {
    const std::string_view text(static_cast<const char*>(message.data()), message.size());
    conduit::log::info("heard: {}", text);
  }
};

int main() {
  Listener node;
  node.run();
}
