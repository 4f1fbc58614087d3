// A node that checks the frames of camera_publisher.cpp: all pixels have the same shade.
#include <algorithm>
#include <cstdint>

#include <conduit_core/log.hpp>
#include <conduit_core/node.hpp>

class CameraSubscriber : public conduit::Node {
public:
  CameraSubscriber() { subscribe("camera_raw", &CameraSubscriber::on_frame); }

private:
  void on_frame(const conduit::Message& message) {
    const auto* pixels = static_cast<const std::uint8_t*>(message.data());
    const auto same_shade = [&](std::uint8_t pixel) { return pixel == pixels[0]; };
    const bool whole = std::all_of(pixels, pixels + message.size(), same_shade);
    if (!whole) conduit::log::error("frame {} is torn", message.sequence());
    if (message.lost() > 0) {
      conduit::log::warn("{} frames lost before {}", message.lost(), message.sequence());
    }
    if (++frames_ % 30 == 0) conduit::log::info("{} frames of {} bytes", frames_, message.size());
  }

  std::uint64_t frames_ = 0;
};

int main() {
  CameraSubscriber node;
  node.run();
}
