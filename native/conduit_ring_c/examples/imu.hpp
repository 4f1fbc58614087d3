// What imu_publisher.cpp and imu_subscriber.cpp have in common: a struct that travels as it lies in memory.
#pragma once

#include <type_traits>

struct ImuData {
  double timestamp;  // seconds
  float accel[3];    // m/s^2
  float gyro[3];     // rad/s
};

static_assert(std::is_trivially_copyable_v<ImuData>, "it is copied byte by byte");
static_assert(sizeof(ImuData) == 32, "no padding");
