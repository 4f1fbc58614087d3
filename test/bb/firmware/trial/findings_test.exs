defmodule BB.Firmware.Trial.FindingsTest do
  use ExUnit.Case, async: true

  alias BB.Firmware.Trial.Findings

  doctest Findings

  @moduletag :tmp_dir

  @report %{
    outcome: :reverted,
    at: ~U[2026-01-02 03:04:05Z],
    firmware: %{"nerves_fw_version" => "0.1.0"},
    reasons: [{{:sensor, :imu}, :never}],
    missing: [{{:sensor, :camera}, "backoff: absent"}]
  }

  test "a report is read as it was written, in a folder that it makes", %{tmp_dir: tmp_dir} do
    folder = Path.join(tmp_dir, "a/b")
    assert Findings.read(folder, :reverted) == nil
    assert Findings.write(folder, @report) == :ok

    assert Findings.read(folder, :reverted) == """
           ganglion guard report 1
           reverted at 2026-01-02T03:04:05Z
           nerves_fw_version 0.1.0
           required: sensor imu: was never good
           optional: sensor camera: backoff: absent
           """

    assert File.ls!(folder) == ["reverted.txt"]
  end

  test "a corrupt file is renamed and counts as missing", %{tmp_dir: tmp_dir} do
    for text <- ["", <<0, 255>>, "ganglion guard report 1\n" <> <<255>>] do
      File.write!(Path.join(tmp_dir, "validated.txt"), text)
      assert Findings.read(tmp_dir, :validated) == nil
      assert File.read!(Path.join(tmp_dir, "validated.txt.corrupt")) == text
      refute File.exists?(Path.join(tmp_dir, "validated.txt"))
    end
  end

  test "a folder that cannot be made is an error", %{tmp_dir: tmp_dir} do
    File.write!(Path.join(tmp_dir, "file"), "")
    assert {:error, _} = Findings.write(Path.join(tmp_dir, "file"), @report)
  end
end
