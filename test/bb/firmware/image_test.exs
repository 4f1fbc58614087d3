defmodule BB.Firmware.ImageTest do
  @moduledoc "What the configuration of boards says, as far as the host can hold it to that."

  use ExUnit.Case, async: true

  alias BB.Test.Keys

  setup_all do
    {:ok, _} = Application.ensure_all_started(:ssh)
    %{config: Config.Reader.read!("config/target.exs", env: :prod, target: :rpi4)}
  end

  describe "a board" do
    test "lets updates in through the gate, by functions that are there", %{config: config} do
      for key <- [:precheck_callback, :success_callback] do
        {module, function, args} = config[:ssh_subsystem_fwup][key]
        assert Code.ensure_loaded?(module)
        assert function_exported?(module, function, length(args))
      end
    end

    test "is built of files that are there", %{config: config} do
      for {_what, path} <- config[:nerves][:firmware], do: assert(File.exists?(path), path)
    end

    test "leaves validation to the guard of ours", %{config: config} do
      assert config[:nerves_runtime][:startup_guard_enabled] == false
    end

    test "starts the watchers of a robot with options that they take", %{config: config} do
      for module <- [BB.Firmware.Guard, BB.Firmware.Gate, BB.Firmware.Network] do
        options = [robot: Ganglion.Robot, name: nil] ++ config[:ganglion][module]
        assert %{start: {^module, :start_link, [^options]}} = module.child_spec(options)
      end

      for {module, _handle} <- [config[:ganglion][:board], config[:ganglion][:network]],
          do: assert(Code.ensure_loaded?(module))
    end

    test "shows rows of ours in its message of the day", %{config: config} do
      {module, function, args} = config[:nerves_motd][:extra_rows]
      assert [[{_, _} | _] | _] = apply(module, function, args)
    end

    test "keeps host keys where updates leave them, and looks at them before ssh does", %{
      config: config
    } do
      assert "/data/" <> _ = config[:nerves_ssh][:system_dir]
      init = config[:nerves_runtime][:init_module]
      assert %{start: {^init, :start_link, _}} = init.child_spec([])
      assert [:nerves_runtime | _] = config[:shoehorn][:init]
    end

    test "keeps nobody's login key that is not in its image", %{config: config} do
      refute String.starts_with?(config[:nerves_ssh][:user_dir], "/data")
    end
  end

  describe "logging in, with the board's options for OTP's ssh," do
    setup %{config: config} do
      {user, public} = Keys.pair()
      {host, _} = Keys.pair()
      options = [key_cb: {Keys, host: host, authorized: [public]}, shell: shell()]

      {:ok, daemon} =
        :ssh.daemon({127, 0, 0, 1}, 0, options ++ config[:nerves_ssh][:daemon_option_overrides])

      on_exit(fn -> :ssh.stop_daemon(daemon) end)
      {:ok, info} = :ssh.daemon_info(daemon)
      %{port: info[:port], user: user}
    end

    # As nerves_ssh starts it, which depends on Elixir's version.
    defp shell do
      file = Path.expand("rootfs_overlay/etc/iex.exs")

      cond do
        Version.match?(System.version(), ">= 1.18.0") ->
          {:iex, :start, [[dot_iex: file], {:elixir_utils, :noop, []}]}

        Version.match?(System.version(), ">= 1.17.0") ->
          {:iex, :start, [[dot_iex_path: file], {:elixir_utils, :noop, []}]}

        true ->
          {IEx, :start, [[dot_iex_path: file]]}
      end
    end

    defp connect(port, key, more \\ []) do
      options = [user: ~c"ada", user_interaction: false, silently_accept_hosts: true]
      :ssh.connect({127, 0, 0, 1}, port, [key_cb: {Keys, user: key}] ++ options ++ more, 10_000)
    end

    test "works with the key, and shows the robot's console", %{port: port, user: user} do
      {:ok, connection} = connect(port, user)
      {:ok, channel} = :ssh_connection.session_channel(connection, 10_000)
      :success = :ssh_connection.ptty_alloc(connection, channel, [])
      :ok = :ssh_connection.shell(connection, channel)
      :ok = :ssh_connection.send(connection, channel, "firmware(:no_guard)\n")
      assert read_until(connection, "is not running") =~ "validation"
      :ssh.close(connection)
    end

    test "fails without a key, with a wrong one, and with a password", %{port: port} do
      {stranger, _} = Keys.pair()
      assert {:error, _} = connect(port, nil)
      assert {:error, _} = connect(port, stranger)
      assert {:error, _} = connect(port, nil, password: ~c"password")
    end
  end

  describe "a script of the firmware's" do
    @scripts Path.wildcard("firmware/scripts/*")

    test "says how it is used, and refuses what it does not know" do
      assert length(@scripts) == 4

      for script <- @scripts do
        assert {"usage: " <> usage, 0} = run(script, ["--help"])
        assert String.starts_with?(usage, script)
        assert {text, 2} = run(script, ["--nonsense"])
        assert text =~ "--nonsense; see --help"
      end
    end

    test "that needs a file says which one is missing" do
      for script <- ~w(burn sign upload) do
        assert {text, 1} = run("firmware/scripts/" <> script, ["no-such-image.fw"])
        assert text =~ "no-such-image.fw is missing"
      end
    end

    defp run(script, args), do: System.cmd(Path.expand(script), args, stderr_to_stdout: true)
  end

  describe "with the real fwup," do
    @describetag :tmp_dir
    unless System.find_executable("fwup"), do: @describetag(skip: "fwup is not installed")

    # What a board's system has of its own, and a small image in the place of the real one.
    @system_provisioning ~s(uboot_setenv(uboot-env, "enable_uboot_overlays", "1"\)\n)
    @image """
    meta-product = "ganglion"
    file-resource payload { host-path = "payload" }
    uboot-environment uboot-env {
      block-offset = 0
      block-count = 16
    }
    task complete {
      on-init {
        uboot_clearenv(uboot-env)
        include("${NERVES_PROVISIONING}")
      }
      on-resource payload { raw_write(64) }
    }
    """

    setup %{tmp_dir: root} do
      File.mkdir_p!(Path.join(root, "firmware"))
      File.cp_r!("firmware/scripts", Path.join(root, "firmware/scripts"))
      File.mkdir_p!(Path.join(root, "fwup_include"))
      File.write!(Path.join(root, "fwup_include/provisioning.conf"), @system_provisioning)
      File.write!(Path.join(root, "payload"), "payload")
      File.write!(Path.join(root, "image.conf"), @image)

      env = [
        {"NERVES_PROVISIONING", Path.expand("firmware/provisioning.conf")},
        {"NERVES_SDK_IMAGES", root}
      ]

      assert {_, 0} = in_folder(root, "fwup", ~w(-c -f image.conf -o app.fw), env)
      :ok
    end

    test "the keys made sign an image that the board's check takes, and no other is taken", %{
      tmp_dir: root
    } do
      assert {_, 0} = in_folder(root, "firmware/scripts/keys", [])
      assert {text, 1} = in_folder(root, "firmware/scripts/keys", [])
      assert text =~ "is there already"
      assert %{mode: mode} = File.stat!(Path.join(root, "firmware/keys/firmware.priv"))
      assert Bitwise.band(mode, 0o077) == 0

      assert {_, 0} = in_folder(root, "firmware/scripts/sign", ["app.fw"])
      assert {_, 0} = checked(root, "app.signed.fw")
      assert {text, 1} = checked(root, "app.fw")
      assert text =~ "Expecting signed firmware"

      File.rm!(Path.join(root, "firmware/keys/firmware.priv"))
      public = Path.join(root, "rootfs_overlay/etc/ganglion/firmware.pub")
      File.rename!(public, public <> ".first")
      assert {_, 0} = in_folder(root, "firmware/scripts/keys", [])
      assert {_, 0} = in_folder(root, "firmware/scripts/sign", ["app.fw", "other.fw"])
      File.rename!(public <> ".first", public)
      assert {text, 1} = checked(root, "other.fw")
      assert text =~ "signature"
    end

    test "a card is told what the environment says, beside what its system writes", %{
      tmp_dir: root
    } do
      env = [
        {"NERVES_SERIAL_NUMBER", "g-0007"},
        {"GANGLION_NAME", "ada"},
        {"GANGLION_WIFI_SSID", ~s(the "lab" $1)}
      ]

      assert {_, 0} = in_folder(root, "firmware/scripts/burn", ["app.fw", "card.img"], env)

      assert told(Path.join(root, "card.img")) == %{
               "enable_uboot_overlays" => "1",
               "nerves_serial_number" => "g-0007",
               "ganglion_name" => "ada",
               "ganglion_wifi_ssid" => ~s(the "lab" $1),
               "ganglion_wifi_passphrase" => "",
               "ganglion_wifi_country" => ""
             }
    end

    # As the board does it: BB.Firmware.Gate gives that option to fwup.
    defp checked(root, image) do
      key = ["--public-key-file", "rootfs_overlay/etc/ganglion/firmware.pub"]
      in_folder(root, "fwup", ~w(-a -q -t complete -d card.img -i) ++ [image | key])
    end

    # U-Boot's environment: a checksum, then name=value, each ended by a zero, up to an empty one.
    defp told(card) do
      <<_crc::32, variables::binary>> = card |> File.read!() |> binary_part(0, 16 * 512)
      [variables, _rest] = :binary.split(variables, <<0, 0>>)

      for variable <- String.split(variables, <<0>>),
          into: %{},
          do: variable |> String.split("=", parts: 2) |> List.to_tuple()
    end

    defp in_folder(root, command, args, env \\ []) do
      command = if command =~ "/", do: Path.join(root, command), else: command
      System.cmd(command, args, cd: root, env: env, stderr_to_stdout: true)
    end
  end

  defp read_until(connection, wanted, read \\ "") do
    if read =~ wanted do
      read
    else
      assert_receive {:ssh_cm, ^connection, {:data, _, _, data}}
      read_until(connection, wanted, read <> data)
    end
  end
end
