// A node that prints every hundredth struct of imu_publisher.cpp.
#include <cstring>

#include <conduit_core/log.hpp>
#include <conduit_core/node.hpp>

#include "imu.hpp"

class ImuSubscriber : public conduit::Node {
public:
  ImuSubscriber() { subscribe("imu_raw", &ImuSubscriber::on_imu); }

private:
  void on_imu(const conduit::Message& message) {
    ImuData data;
    if (message.size() != sizeof data) {
      conduit::log::error("expected an ImuData of {} bytes, got: {} bytes", sizeof data,
                          message.size());
      return;
    }
    std::memcpy(&data, message.data(), sizeof data);
    if (message.sequence() % 100 == 0) {
      conduit::log::info("{:.3f} s: accel z {:.2f} m/s^2, gyro z {:.3f} rad/s", data.timestamp,
                         data.accel[2], data.gyro[2]);
    }
  }
};

int main() {
  ImuSubscriber node;
  node.run();
}
