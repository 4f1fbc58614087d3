// A node that publishes a struct 100 times per second.
#include <chrono>
#include <cmath>

#include <conduit_core/node.hpp>

#include "imu.hpp"

class ImuPublisher : public conduit::Node {
public:
  ImuPublisher() : publisher_(advertise("imu_raw")) { loop(100.0, &ImuPublisher::tick); }

private:
  void tick() {
    const std::chrono::duration<double> now = std::chrono::steady_clock::now().time_since_epoch();
    ImuData data{};
    data.timestamp = now.count();
    data.accel[2] = 9.80665F;
    data.gyro[2] = static_cast<float>(std::sin(now.count()));
    publisher_.publish(&data, sizeof data);
  }

  conduit::Publisher publisher_;
};

int main() {
  ImuPublisher node;
  node.run();
}
