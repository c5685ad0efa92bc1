// SPDX-License-Identifier: MIT
// For programs all of whose tests need a device.
bool tests_need_a_device = true; // see main.cpp
