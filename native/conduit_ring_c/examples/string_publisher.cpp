// A node that publishes a text once per second.
#include <string>

#include <conduit_core/log.hpp>
#include <conduit_core/node.hpp>

class Talker : public conduit::Node {
public:
  Talker() : publisher_(advertise("chatter")) { loop(1.0, &Talker::tick); }

private:
  void tick() {
    const std::string text = "hello " + std::to_string(count_++);
    publisher_.publish(text.data(), text.size());
    conduit::log::info("published: {}", text);
  }

  conduit::Publisher publisher_;
  int count_ = 0;
};

int main() {
  Talker node;
  node.run();
}
