// The message of imu_publisher.cpp and imu_subscriber.cpp: a struct that is copied byte by byte.
#pragma once

#include <type_traits>

struct ImuData {
  double timestamp;  // seconds
  float accel[3];    // m/s^2
  float gyro[3];     // rad/s
};

static_assert(std::is_trivially_copyable_v<ImuData>, "expected a trivially copyable struct");
static_assert(sizeof(ImuData) == 32, "expected a struct without padding");
