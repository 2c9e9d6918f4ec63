#pragma once

// A small C++ layer on rcl, the C library of ROS 2. One header for all of it.
#include "ros/rcl/action_client.hpp"
#include "ros/rcl/action_server.hpp"
#include "ros/rcl/context.hpp"
#include "ros/rcl/executor.hpp"
#include "ros/rcl/node.hpp"
#include "ros/rcl/publisher.hpp"
#include "ros/rcl/service.hpp"
