// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/io/write_particles.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <ostream>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace firn
{

/// A table that grows by a row of numbers at a time, such as the energy of a run: text with commas, under a
/// row of names. Each row is in the file when add() returns; a program that is killed may leave half of its
/// last one.
class CsvSeries
{
public:
    /// Begins the file anew with the names of its columns, such as "time [s]". Throws firn::Error if it
    /// cannot be created, or if a name is missing, occurs twice, or has a comma, a quotation mark or an end
    /// of line in it.
    CsvSeries(std::filesystem::path path, std::vector<std::string> names)
        : path_(std::move(path)), columns_(names.size())
    {
        require(!names.empty(), "a table has no column", path_.string().c_str(), "Pass a name for each.");
        std::string head;
        for (auto name = names.begin(); name != names.end(); ++name) {
            bool const plain = !name->empty() && name->find_first_of(",\"\n\r") == std::string::npos;
            if (!plain || std::find(names.begin(), name, *name) != name)
                throw Error{"the column name '" + *name + "' is not plain, or occurs twice", path_.string(),
                            "Pass a name of its own for each, without commas, quotes and line ends."};
            head += (name == names.begin() ? "" : ",") + *name;
        }
        detail::replace_file(path_, [&](std::ostream& out) { out << head << '\n'; });
    }

    /// Adds a row: one number for each column. Throws firn::Error, and adds none, if there are more or fewer,
    /// or if the file cannot be written.
    void add(std::initializer_list<double> row) { add(std::vector<double>(row)); }
    void add(std::vector<double> const& row)
    {
        if (row.size() != columns_)
            throw Error{"a row has " + std::to_string(row.size()) + " numbers for " +
                            std::to_string(columns_) + " columns",
                        path_.string(), "Pass one number for each column."};
        std::string text;
        for (double const number : row) text += (text.empty() ? "" : ",") + detail::exact_text(number);
        text += '\n';
        std::error_code gone;
        auto const before = std::filesystem::file_size(path_, gone);
        if (gone)
            throw Error{"the file is no longer there", path_.string(),
                        "Begin a new one, under another name."};
        std::ofstream out(path_, std::ios::binary | std::ios::app);
        out.write(text.data(), static_cast<std::streamsize>(text.size()));
        out.close();
        if (out) return;
        std::filesystem::resize_file(path_, before,
                                     gone); // else the next row would go on behind half of this one
        throw Error{"a row could not be written", path_.string(),
                    "Is the disk full, or has the folder gone?"};
    }

private:
    std::filesystem::path path_;
    std::size_t columns_;
};

} // namespace firn
