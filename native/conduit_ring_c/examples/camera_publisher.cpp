// A node that publishes frames of 2,000,000 bytes 30 times per second, in a ring of 4 slots.
#include <cstdint>
#include <vector>

#include <conduit_core/log.hpp>
#include <conduit_core/node.hpp>

class CameraPublisher : public conduit::Node {
public:
  CameraPublisher() : publisher_(advertise("camera_raw", config())), frame_(2'000'000) {
    loop(30.0, &CameraPublisher::tick);
  }

private:
  static conduit::RingBufferConfig config() {
    conduit::RingBufferConfig config;
    config.slot_count = 4;
    config.slot_size = 2'100'000;
    return config;
  }

  void tick() {
    ++shade_;
    for (auto& pixel : frame_) pixel = shade_;
    if (!publisher_.publish(frame_.data(), frame_.size())) {
      conduit::log::error("frame does not fit into a slot");
    }
  }

  conduit::Publisher publisher_;
  std::vector<std::uint8_t> frame_;
  std::uint8_t shade_ = 0;
};

int main() {
  CameraPublisher node;
  node.run();
}
