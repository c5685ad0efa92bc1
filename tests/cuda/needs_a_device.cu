// SPDX-License-Identifier: MIT
// For programs in which all tests need a device.
bool tests_need_a_device = true; // see main.cpp
